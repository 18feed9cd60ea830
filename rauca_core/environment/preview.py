"""One picture that shows what the extractor made of an image: its light maps, and the vehicle in other paint."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError
from ..contract.color import Color, linear_to_srgb, recolor, srgb_to_linear, to_bytes
from ..contract.seeding import named_rng
from ..runtime.images import read_image
from .estimate import estimate_image
from .exact import Light
from .extractor import LightSplitter

Image = NDArray[np.uint8]

COLORS: tuple[Color, ...] = ((255, 255, 255), (12, 12, 12), (200, 16, 16), (16, 60, 200))
LONGEST = 2048  # pixels; the network's memory grows with the area, 2 GB there
GAP = 4  # pixels between pictures
COLUMNS = 4


def preview(image: Path, mask: Path, reference_srgb: Color, extractor: LightSplitter) -> Image:
    """Estimate the light of an image file and lay out the sheet.

    Args:
        image: any image.
        mask: grey, white where the paint is; of the image's size.
        reference_srgb: 8-bit color of the paint in the image.

    Returns:
        (H, W, 3): the image, its mask, A and B; the vehicle in four colors; and in four patterns.

    Raises:
        RaucaError: files that do not fit each other, an empty mask, an image too large.
    """
    pixels, coverage = read_image(image), read_image(mask)
    if pixels.ndim == 2:
        pixels = np.repeat(pixels[..., None], 3, 2)
    if coverage.ndim == 3:
        raise RaucaError(f"{mask}: is in color; give a grey mask, white where the paint is")
    height, width = pixels.shape[:2]
    if coverage.shape != (height, width):
        raise RaucaError(
            f"{mask}: is {coverage.shape[1]}x{coverage.shape[0]} pixels, {image} is {width}x{height}; give a mask of "
            "the image's size"
        )
    if max(height, width) > LONGEST:
        raise RaucaError(f"{image}: is {width}x{height} pixels; at most {LONGEST} a side are lit, make it smaller")
    if coverage.max(initial=0) < 128:
        raise RaucaError(f"{mask}: is empty; paint white where the paint is")
    light = estimate_image(pixels, coverage / np.float32(255), reference_srgb, extractor)
    return _sheet(pixels, coverage, light)


def _sheet(image: Image, coverage: Image, light: Light) -> Image:
    shown = [image, np.repeat(coverage[..., None], 3, 2), _displayed(light.A), _displayed(light.B)]
    shown += [_displayed(color) for color in recolor(light.A, light.B, np.array(COLORS, np.float32))]
    shown += [_displayed(light.A * srgb_to_linear(p) + light.B) for p in _patterns(*coverage.shape)]
    rows = [_join(shown[i : i + COLUMNS], 1) for i in range(0, len(shown), COLUMNS)]
    return _join(rows, 0)


def _patterns(height: int, width: int) -> list[NDArray[np.float32]]:
    """Stripes, a chequer, blotches and saturated noise, sRGB (H, W, 3), fixed to the image: no UV map is known."""
    y, x = np.mgrid[:height, :width]
    cell, rng = max(2, max(height, width) // 40), named_rng("preview")
    black, red, white, green = (np.array(c, np.float32) for c in ((0, 0, 0), (0.8, 0.1, 0.1), (1, 1, 1), (0.1, 0.5, 0)))
    stripes = np.where(((x + y) // cell % 2 == 0)[..., None], black, white)
    chequer = np.where(((x // cell + y // cell) % 2 == 0)[..., None], red, white)
    coarse = rng.random((height // (2 * cell) + 1, width // (2 * cell) + 1, 1)).astype(np.float32)
    spread = coarse.repeat(2 * cell, 0).repeat(2 * cell, 1)[:height, :width]
    blotches = np.where(spread < 0.4, green, np.where(spread < 0.7, black, np.array([0.6, 0.5, 0.3], np.float32)))
    noise = (rng.random((height // 4 + 1, width // 4 + 1, 3)) < 0.5).astype(np.float32)
    saturated = noise.repeat(4, 0).repeat(4, 1)[:height, :width]
    return [np.asarray(p, np.float32) for p in (stripes, chequer, blotches, saturated)]


def _displayed(linear: NDArray[np.floating]) -> Image:
    return to_bytes(linear_to_srgb(linear))


def _join(pictures: list[Image], axis: int) -> Image:
    gap = list(pictures[0].shape)
    gap[axis] = GAP
    between = np.full(gap, 255, np.uint8)
    parts = [part for picture in pictures for part in (between, picture)][1:]
    return np.concatenate(parts, axis)
