"""JPEG compression: throws away the high frequencies that many attacks live in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .interface import Configured, from_pixels, require, to_pixels


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
