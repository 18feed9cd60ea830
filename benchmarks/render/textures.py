"""What is painted on the car to measure errors with: every frequency at full strength, and those of a photograph."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from rauca_core.render import Pyramid

TEXTURES = ("noise", "photograph-like")
Map = NDArray[np.float32]


def uv_map(kind: str, pyramid: Pyramid, seed: int = 0) -> Map:
    """A UV map (size, size, 3), linear, as a camouflage is exported: gutters are filled from the paint beside them."""
    drawn = (_noise if kind == "noise" else _photograph)(pyramid.size, np.random.default_rng(seed))
    texels = pyramid.from_map(torch.from_numpy(drawn.transpose(2, 0, 1).copy()))
    return np.ascontiguousarray(pyramid.to_map(texels).permute(1, 2, 0).numpy())


def _noise(size: int, rng: np.random.Generator) -> Map:
    """Independent uniform texels in [0, 1]: the hardest texture there is for a sampler."""
    return rng.random((size, size, 3), dtype=np.float32)


def _photograph(size: int, rng: np.random.Generator) -> Map:
    """Discs of all sizes over one another (dead leaves), each with a 1/f texture: the statistics of natural images.

    The project holds no photograph; edges at every scale and a 1/f spectrum are what matters to a sampler.
    """
    image = np.full((size, size, 3), 0.5, np.float32)
    smallest, largest, number = size / 512, size / 6, 20_000  # enough to cover the map several times
    # Radii of density r^-3 make the pattern look the same at every scale.
    radii = (smallest**-2 - rng.random(number) * (smallest**-2 - largest**-2)) ** -0.5
    for radius, x, y in zip(radii, *(rng.random((2, number)) * size), strict=True):
        x0, x1 = max(0, int(x - radius)), min(size, int(x + radius) + 1)
        y0, y1 = max(0, int(y - radius)), min(size, int(y + radius) + 1)
        disc = np.hypot(np.arange(x0, x1)[None] + 0.5 - x, np.arange(y0, y1)[:, None] + 0.5 - y) < radius
        image[y0:y1, x0:x1][disc] = rng.random(3)
    return np.clip(image + 0.1 * _pink(size, rng), 0, 1).astype(np.float32)


def _pink(size: int, rng: np.random.Generator) -> Map:
    """Noise (size, size, 3) of amplitude 1/f, mean 0, deviation 1."""
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None])
    frequency[0, 0] = np.inf
    planes = [np.fft.irfft2(np.fft.rfft2(rng.standard_normal((size, size))) / frequency) for _ in range(3)]
    return np.stack([p / p.std() for p in planes], 2).astype(np.float32)
