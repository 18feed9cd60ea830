"""Cutting an image into segments, where PAD uses Segment Anything."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray


class Segmenter(Protocol):
    """What PAD snaps its heat map to; Segment Anything's automatic masks fit in here.

    Attributes:
        fingerprint: changes with the segments; part of the defence's fingerprint.
    """

    @property
    def fingerprint(self) -> str: ...

    def __call__(self, pixels: NDArray[np.uint8]) -> Iterable[NDArray[np.bool_]]:
        """(H, W, 3) 8-bit RGB -> masks (H, W), which may overlap, most important first."""
        ...


@dataclass(frozen=True)
class Superpixels:
    """SLIC superpixels (Achanta et al. 2012, its zero-parameter variant), blurred a little against noise.

    Attributes:
        per_side: superpixels along the shorter side of the image.
    """

    per_side: int = 16

    @property
    def fingerprint(self) -> str:
        return f"superpixels/1 per_side={self.per_side} opencv={cv2.__version__}"

    def __call__(self, pixels: NDArray[np.uint8]) -> Iterable[NDArray[np.bool_]]:
        """(H, W, 3) 8-bit RGB -> masks (H, W) that tile the image."""
        labels = self.labels(pixels)
        for label in range(labels.max() + 1):
            yield labels == label

    def labels(self, pixels: NDArray[np.uint8]) -> NDArray[np.int32]:
        """(H, W, 3) 8-bit RGB -> (H, W) number of each pixel's superpixel, from 0."""
        region = max(4, min(pixels.shape[:2]) // self.per_side)
        if min(pixels.shape[:2]) < 2 * region:  # too few pixels to cluster
            return np.zeros(pixels.shape[:2], np.int32)
        lab = cv2.cvtColor(cv2.GaussianBlur(pixels, (3, 3), 0), cv2.COLOR_RGB2LAB)
        slic = cv2.ximgproc.createSuperpixelSLIC(lab, cv2.ximgproc.SLICO, region_size=region)
        slic.iterate(10)
        slic.enforceLabelConnectivity(25)
        return np.asarray(slic.getLabels(), np.int32)
