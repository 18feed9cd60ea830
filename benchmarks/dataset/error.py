"""Distance from a converged frame, with the reference's own noise taken out."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rauca_core.contract.color import linear_to_srgb

Image = NDArray[np.float32]
SMALLEST = 1e-8  # of a mean square error: 80 dB


class Halves(NamedTuple):
    """Two independent renders of one frame, (H, W, 3) linear, without the denoiser."""

    first: Image
    second: Image


class SquaredErrors(NamedTuple):
    """Mean square errors of frames: of display values, of linear light up to display white, of display on the paint."""

    display: float
    linear: float
    paint: float


def squared_errors(found: Image, reference: Halves, painted: NDArray[np.bool_]) -> SquaredErrors:
    """Unbiased by the reference's noise: the error against one half times the error against the other.

    The noise of the halves is independent, so it averages out of the product; squaring the error against their mean
    would count it in full.
    """
    display = _product(linear_to_srgb(found), *(linear_to_srgb(half) for half in reference))
    linear = _product(np.clip(found, 0, 1), *(np.clip(half, 0, 1) for half in reference))
    paint = float(display[painted].mean()) if painted.any() else 0.0
    return SquaredErrors(float(display.mean()), float(linear.mean()), paint)


def psnr_db(squared_errors: list[float]) -> float:
    """Peak signal to noise ratio of the mean of squared errors; the peak is 1, display white."""
    return -10 * math.log10(max(float(np.mean(squared_errors)), SMALLEST))


def _product(found: NDArray[np.floating], first: NDArray[np.floating], second: NDArray[np.floating]) -> Image:
    return ((found - first).astype(np.float64) * (found - second)).astype(np.float32)
