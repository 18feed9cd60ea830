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
        """(H, W, 3) 8-bit RGB -> masks (H, W) bool, which may overlap; of those that do, the first counts."""
        ...


@dataclass(frozen=True)
class GraphSegments:
    """Superpixels that grow with the content (Felzenszwalb and Huttenlocher, IJCV 2004), over Lab color.

    Neighbors merge while their border differs no more than they do inside: a smooth door or a patch of noise becomes
    one segment. That is nearer to Segment Anything's things and parts than superpixels of even size, which cut both to
    pieces. The defaults are the authors' for images of 320x240.

    Attributes:
        scale: their k; larger segments with larger values.
        blur: standard deviation of the Gaussian before it, pixels; their sigma.
        smallest: side of the smallest segment's square, as a share of the image's shorter side.
    """

    scale: float = 300.0
    blur: float = 0.8
    smallest: float = 1 / 32

    @property
    def fingerprint(self) -> str:
        """Kind, version and every parameter, and the version of the library that cuts."""
        return f"graph/1 scale={self.scale} blur={self.blur} smallest={self.smallest} opencv={cv2.__version__}"

    def __call__(self, pixels: NDArray[np.uint8]) -> Iterable[NDArray[np.bool_]]:
        """(H, W, 3) 8-bit RGB -> masks (H, W) that tile the image."""
        labels = self.labels(pixels)
        for label in range(labels.max() + 1):
            yield labels == label

    def labels(self, pixels: NDArray[np.uint8]) -> NDArray[np.int32]:
        """(H, W, 3) 8-bit RGB -> (H, W) number of each pixel's segment, from 0."""
        fewest = max(1, round((self.smallest * min(pixels.shape[:2])) ** 2))
        graph = cv2.ximgproc.segmentation.createGraphSegmentation(self.blur, self.scale, fewest)
        return np.asarray(graph.processImage(cv2.cvtColor(pixels, cv2.COLOR_RGB2LAB)), np.int32)
