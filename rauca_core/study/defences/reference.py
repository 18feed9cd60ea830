"""The cheapest defences, to see whether the elaborate ones earn their keep: nothing, fewer greys, a median, JPEG."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from .interface import Configured, from_pixels, require, to_pixels


@dataclass(frozen=True)
class Nothing(Configured):
    """No defence: the images as they are."""

    kind: ClassVar[str] = "none"
    version: ClassVar[int] = 1

    def __call__(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) sRGB -> the same tensor, once checked."""
        self.check(images)
        return images


@dataclass(frozen=True)
class BitDepth(Configured):
    """Fewer grey levels per channel (Xu, Evans, Qi: Feature Squeezing, NDSS 2018). Its gradient is zero.

    Attributes:
        depth: bits per channel, 1 to 8.
    """

    kind: ClassVar[str] = "bits"
    version: ClassVar[int] = 1
    depth: int = 5

    def __post_init__(self) -> None:
        require(1 <= self.depth <= 8, self.kind, f"depth={self.depth}", "give 1 to 8 bits per channel")

    def __call__(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) sRGB -> rounded to the nearest of 2^depth evenly spaced values."""
        self.check(images)
        levels = 2**self.depth - 1
        return (images * levels).round() / levels


@dataclass(frozen=True)
class Median(Configured):
    """Median over a square neighborhood, per channel (Feature Squeezing again); the border is repeated outwards.

    Differentiable: the gradient reaches the pixel that was the median.

    Attributes:
        size: side of the neighborhood, pixels, odd.
    """

    kind: ClassVar[str] = "median"
    version: ClassVar[int] = 1
    size: int = 3

    def __post_init__(self) -> None:
        valid = 1 <= self.size <= 15 and self.size % 2 == 1
        require(valid, self.kind, f"size={self.size}", "give an odd number of pixels, 1 to 15")

    def __call__(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) sRGB -> smoothed."""
        self.check(images)
        reach = self.size // 2
        padded = functional.pad(images, (reach,) * 4, mode="replicate")
        neighborhoods = padded.unfold(2, self.size, 1).unfold(3, self.size, 1)
        return neighborhoods.flatten(-2).median(dim=-1).values


@dataclass(frozen=True)
class Jpeg(Configured):
    """Save and load as JPEG (Dziugaite, Ghahramani, Roy 2016; default quality as theirs). Not differentiable.

    Attributes:
        quality: of libjpeg, 1 to 100.
    """

    kind: ClassVar[str] = "jpeg"
    version: ClassVar[int] = 1
    quality: int = 75

    def __post_init__(self) -> None:
        require(1 <= self.quality <= 100, self.kind, f"quality={self.quality}", "give 1 to 100")

    @property
    def fingerprint(self) -> str:
        """As of every defence, and the version of the library that holds the codec."""
        return f"{super().fingerprint} opencv={cv2.__version__}"

    def __call__(self, images: Tensor) -> Tensor:
        """(B, 3, H, W) sRGB -> 8-bit values after one round trip, without gradient."""
        self.check(images)
        defended = torch.empty_like(images, requires_grad=False)
        for out, image in zip(defended, images, strict=True):
            out.copy_(from_pixels(round_trip(to_pixels(image), self.quality), like=image))
        return defended


def round_trip(pixels: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """(H, W, 3) 8-bit RGB -> the same after JPEG at a quality of 1 to 100, chroma at half resolution (4:2:0)."""
    # The codec wants BGR: chroma is weighted by channel.
    _, data = cv2.imencode(".jpg", pixels[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return np.asarray(decoded, np.uint8)[:, :, ::-1]
