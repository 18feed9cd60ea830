"""What each renderer's error looks like: the same crop of the same view, beside its distance from the reference."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .accuracy import premultiplied
from .contenders import contenders
from .scenes import Scene

CROP = 72  # pixels
ZOOM = 4
GAIN = 4  # of the differences
TEXTURE = 1  # photograph-like: noise looks alike in every renderer
SHOWN = (1, 2, 4, 8)


def save_pictures(scene: Scene, folder: Path) -> list[Path]:
    """Save the reference, and a picture per renderer: its result, and the absolute difference times `GAIN`."""
    folder.mkdir(parents=True, exist_ok=True)
    view = int(np.argmax([(r.coverage > 0).sum() for r in scene.references]))
    reference = scene.references[view].colors[TEXTURE]
    window = _busiest(scene.references[view].coverage)
    saved = [_save(reference[window], None, folder / "reference.jpg")]
    for contender in contenders(SHOWN):
        taps = contender.taps(scene.car.vehicle, scene.cameras[view], scene.car.pyramid)
        found = premultiplied(taps, scene.car.texels[TEXTURE])
        difference = np.abs(found - reference)
        name = re.sub(r"[^a-z0-9]+", "-", contender.name.lower())
        saved.append(_save(found[window], difference[window], folder / f"{name}.jpg"))
    return saved


def _busiest(coverage: NDArray[np.float64]) -> tuple[slice, slice]:
    """The crop with the most paint edges that is still mostly paint."""
    side = min(CROP, *coverage.shape)
    partly = ((coverage > 0.02) & (coverage < 0.98)) + 0.1 * (coverage > 0.98)
    total = np.pad(partly.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    sums = total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]
    y, x = np.unravel_index(np.argmax(sums), sums.shape)
    return slice(int(y), int(y) + side), slice(int(x), int(x) + side)


def _save(linear: NDArray[np.floating], difference: NDArray[np.floating] | None, path: Path) -> Path:
    """Colors are encoded by a square root, near enough to sRGB to look at; differences stay linear."""
    parts = [np.sqrt(np.clip(linear, 0, 1))]
    if difference is not None:
        parts.append(np.clip(difference * GAIN, 0, 1))
    joined = (np.concatenate(parts, 1) * 255).astype(np.uint8).repeat(ZOOM, 0).repeat(ZOOM, 1)
    Image.fromarray(joined).save(path, quality=80)
    return path
