"""The cheapest defences, to see whether the elaborate ones earn their keep: nothing, fewer greys, a median, JPEG."""

from __future__ import annotations

from typing import ClassVar

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, field_validator
from torch import Tensor
from torch.nn import functional

from .interface import NO_DEFENCE, Defence, from_pixels, to_pixels
from .smooth_jpeg import smooth_jpeg


class Nothing(Defence):
    """No defence: the images as they are."""

    kind: ClassVar[str] = NO_DEFENCE

    def _defend(self, images: Tensor) -> Tensor:
        return images


class BitDepth(Defence):
    """Fewer grey levels per channel (Xu, Evans, Qi: Feature Squeezing, NDSS 2018). Its gradient is zero.

    Attributes:
        depth: bits per channel; values become the nearest of 2^depth evenly spaced ones.
    """

    kind: ClassVar[str] = "bits"
    depth: int = Field(5, ge=1, le=8)

    def _defend(self, images: Tensor) -> Tensor:
        levels = 2**self.depth - 1
        return (images * levels).round() / levels


class Median(Defence):
    """Median over a square neighborhood, per channel (Feature Squeezing again); the border is repeated outwards.

    Differentiable: the gradient reaches the pixel that was the median.

    Attributes:
        size: side of the neighborhood, pixels, odd.
    """

    kind: ClassVar[str] = "median"
    size: int = Field(3, ge=1, le=15)

    @field_validator("size")
    @classmethod
    def _odd(cls, size: int) -> int:
        if size % 2 == 0:
            raise ValueError("must be odd")
        return size

    def _defend(self, images: Tensor) -> Tensor:
        padded = functional.pad(images, (self.size // 2,) * 4, mode="replicate")
        neighborhoods = padded.unfold(2, self.size, 1).unfold(3, self.size, 1)
        return neighborhoods.flatten(-2).median(dim=-1).values

    def stand_in(self, images: Tensor) -> Tensor:
        return self._defend(images)


class Jpeg(Defence):
    """Save and load as JPEG (Dziugaite, Ghahramani, Roy 2016; default quality as theirs). It is not differentiable: an
    attacker differentiates :func:`smooth_jpeg`.

    Attributes:
        quality: of libjpeg.
    """

    kind: ClassVar[str] = "jpeg"
    quality: int = Field(75, ge=1, le=100)

    @property
    def fingerprint(self) -> str:
        """As of every defence, and the version of the library that holds the codec."""
        return f"{super().fingerprint} opencv={cv2.__version__}"

    def _defend(self, images: Tensor) -> Tensor:
        defended = torch.empty_like(images, requires_grad=False)
        for out, image in zip(defended, images, strict=True):
            out.copy_(from_pixels(round_trip(to_pixels(image), self.quality), like=image))
        return defended

    def stand_in(self, images: Tensor) -> Tensor:
        return smooth_jpeg(images, self.quality)


def round_trip(pixels: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """(H, W, 3) 8-bit RGB -> the same after JPEG at a quality of 1 to 100, chroma at half resolution (4:2:0)."""
    # The codec wants BGR: chroma is weighted by channel.
    _, data = cv2.imencode(".jpg", pixels[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return np.asarray(decoded, np.uint8)[:, :, ::-1]
