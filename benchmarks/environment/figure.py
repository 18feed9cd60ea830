"""Pictures for the page: reference, A, B, the textured car as our extractor lights it, the truth, the error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
import torch
from PIL import Image
from torch import Tensor

from rauca_core.environment import LightSplitter
from rauca_core.environment.estimate import estimate
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.methods import splitter_render
from rauca_core.render import linear_to_srgb

from .curve import TEXTURE, Point
from .truth import Truth

matplotlib.use("Agg")
import matplotlib.pyplot as plt

GAIN = 4  # of the error
ZOOM = 2
GAP = 4
COLUMNS = ("reference", "A", "B", "rendered", "Cycles", f"error x {GAIN}")


def save_figure(
    frames: LightFrames, truths: Sequence[Truth], net: LightSplitter, weathers: Sequence[str], path: Path
) -> Path:
    """One row per weather."""
    rows = []
    for weather in weathers:
        truth = next(t for t in truths if t.texture == TEXTURE and frames.get(t.index).weather == weather)
        rows.append(_row(frames, truth, net))
    gap = np.full((GAP, rows[0].shape[1], 3), 255, np.uint8)
    joined = np.concatenate([part for row in rows for part in (gap, row)][1:])
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(joined.repeat(ZOOM, 0).repeat(ZOOM, 1)).save(path, quality=85)
    return path


def _row(frames: LightFrames, truth: Truth, net: LightSplitter) -> np.ndarray:
    frame = frames.get(truth.index)
    light = estimate(frames.datasets[0], frames.places[truth.index].frame.id, net)
    seen = splitter_render(net, frame)(truth.albedo)[0]
    paint = frame.paint > 0
    # The truth was rendered around the paint only; the rest of the frame is the data set's own.
    rendered = (truth.first + truth.second) / 2 * paint + frame.image / 255 * ~paint
    error = ((seen - rendered).abs() * paint * GAIN).clamp(max=1.0)
    maps = (linear_to_srgb(_tensor(m)) for m in (light.A, light.B))
    pictures = [frame.image / 255, *maps, seen, rendered, error]
    gap = np.full((frame.image.shape[1], GAP, 3), 255, np.uint8)
    return np.concatenate([part for p in pictures for part in (gap, _bytes(p))][1:], 1)


def _tensor(image: np.ndarray) -> Tensor:
    return torch.from_numpy(image.transpose(2, 0, 1).copy())


def _bytes(image: Tensor) -> np.ndarray:
    return (image.permute(1, 2, 0).numpy() * 255 + 0.5).astype(np.uint8)


def save_curve(points: Sequence[Point], weathers: Sequence[str], path: Path) -> Path:
    """Error against CPU seconds per texture, one panel per weather."""
    figure, panels = plt.subplots(
        1, len(weathers), figsize=(3.2 * len(weathers), 3.2), sharey=True, layout="constrained", squeeze=False
    )
    for axes, weather in zip(panels[0], weathers, strict=True):
        rows = sorted((p for p in points if p.weather == weather), key=lambda p: p.samples)
        lines = (
            ("rendering the car", [p.render_s for p in rows], [p.render_db for p in rows], "s--"),
            ("maps, 1st texture", [p.seconds(1) for p in rows], [p.maps_db for p in rows], "o-"),
            ("maps, 10th texture", [p.seconds(10) for p in rows], [p.maps_db for p in rows], "^-"),
        )
        for label, seconds, db, style in lines:
            axes.plot(seconds, db, style, label=label, markersize=4)
        axes.set(title=weather, xlabel="CPU s per texture", xscale="log")
        axes.grid(alpha=0.3)
    panels[0][0].set_ylabel("PSNR inside the paint, dB")
    panels[0][0].legend(fontsize=7)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)
    plt.close(figure)
    return path
