"""Where an image changes most when saved as JPEG again: PAD's second heat map."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .jpeg import round_trip

QUALITIES = range(51, 101)
SMOOTHING_PIXELS = 17


def recompression_map(pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Mean over JPEG qualities 51 to 100 of the smoothed squared difference to the re-saved image, (H, W) in [0, 1].

    At every quality the difference is averaged over 17x17 pixels and scaled to [0, 1] over the image. A region whose
    history of compression differs from the rest stands out; so does fine texture where there is no such history.

    Args:
        pixels: (H, W, 3) 8-bit RGB.
    """
    total = np.zeros(pixels.shape[:2], np.float32)
    for quality in QUALITIES:
        difference = cv2.absdiff(pixels, round_trip(pixels, quality)).astype(np.float32)
        squared = np.square(difference).mean(axis=2)
        total += scaled(cv2.blur(squared, (SMOOTHING_PIXELS, SMOOTHING_PIXELS), borderType=cv2.BORDER_REFLECT))
    return total / len(QUALITIES)


def scaled(heat: NDArray[np.float32]) -> NDArray[np.float32]:
    """From its own range to [0, 1]; 0 where the heat is the same everywhere."""
    low, high = heat.min(), heat.max()
    return (heat - low) / (high - low) if high > low else np.zeros_like(heat)
