"""PAD, patch-agnostic defence (Jing, Wang, Ren, Dong, Zou, CVPR 2024): find the patch by two heat maps, paint it black.

An adversarial patch shares little with its surroundings and has another history of compression. Two heat maps look for
that; where their mean is high, whole segments of the image are masked out. No training, no knowledge of the attack.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor

from .heat_maps import mutual_information_map, recompression_map, scaled, smooth_heat
from .interface import Defence, to_pixels

SOFTNESS = 0.05  # of the smooth threshold, in scaled heat
MOST_SHARED = 0.1  # of a segment that is masked already


@runtime_checkable
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


class Pad(Defence):
    """PAD with the published parameters, and superpixels where the authors use Segment Anything.

    That step is a deviation: :class:`GraphSegments` needs no weights, but knows colors, not objects. Its segments are
    smaller where things are colorful, and do not overlap, so the mask follows the heat map more closely. Pass
    ``segmenter`` to use the real one.

    The gradient passes through the pixels that stay; the mask counts as constant.

    Attributes:
        weight: of the mutual information among the two maps; the rest is the recompression's.
        percentile: of the fused map, above which a pixel is suspect.
        kernel: the morphology's unit is the shorter side over this.
        covered: fraction of a segment that must be suspect for it to be masked.
        segmenter: cuts the image into segments.
    """

    kind: ClassVar[str] = "pad"
    weight: float = Field(0.5, ge=0, le=1)
    percentile: float = Field(80.0, ge=0, le=100)
    kernel: int = Field(80, ge=1)
    covered: float = Field(0.5, ge=0, lt=1)
    segmenter: Segmenter = Field(default_factory=GraphSegments)

    @property
    def fingerprint(self) -> str:
        """As of every defence, and the segmenter's and the version of the library that holds the codec."""
        return f"{super().fingerprint} {self.segmenter.fingerprint} opencv={cv2.__version__}"

    def _defend(self, images: Tensor) -> Tensor:
        """Black where a patch is suspected."""
        masks = np.array([self.mask(to_pixels(image)) for image in images], bool)
        masks = masks.reshape(len(images), 1, *images.shape[2:])
        return images.masked_fill(torch.from_numpy(masks).to(images.device), 0)

    def stand_in(self, images: Tensor) -> Tensor:
        """Darkened by a smooth mask: how far the smooth heat lies above its percentile.

        Morphology and segments have no counterpart; the gradient says where heat, and with it the mask, grows.
        """
        heat = smooth_heat(images, self.weight)
        limit = heat.detach().flatten(1).float().quantile(self.percentile / 100, 1)[:, None, None, None].to(heat)
        return images * (1 - ((heat - limit) / SOFTNESS).sigmoid())

    def mask(self, pixels: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """(H, W, 3) 8-bit RGB -> (H, W), true where a patch is suspected."""
        suspect = self.suspect(self.heat(pixels))
        found = np.zeros_like(suspect)
        if not suspect.any():
            return found
        for segment in self.segmenter(pixels):
            area = np.count_nonzero(segment)
            inside = np.count_nonzero(segment & suspect)
            if inside > self.covered * area and np.count_nonzero(segment & found) < MOST_SHARED * area:
                found |= segment
        return found

    def heat(self, pixels: NDArray[np.uint8]) -> NDArray[np.float32]:
        """(H, W, 3) 8-bit RGB -> the fused map, (H, W) in [0, 1]."""
        grey = np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), np.uint8)
        return self.weight * scaled(mutual_information_map(grey)) + (1 - self.weight) * scaled(
            recompression_map(pixels)
        )

    def suspect(self, heat: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Pixels above the percentile, (H, W), without specks and holes: opened, closed twice, opened twice again."""
        hot = (heat > np.percentile(heat, self.percentile)).astype(np.uint8)
        unit = max(1, min(heat.shape) // self.kernel)
        for operation, units, times in (
            (cv2.MORPH_OPEN, 2, 1),
            (cv2.MORPH_CLOSE, 1, 2),
            (cv2.MORPH_OPEN, 3, 2),
        ):
            side = units * unit | 1  # odd: an even kernel shifts the mask
            square = np.ones((side, side), np.uint8)
            hot = np.asarray(cv2.morphologyEx(hot, operation, square, iterations=times), np.uint8)
        return hot > 0
