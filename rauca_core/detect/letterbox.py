"""Fit an image of any size into the detector's square, and map boxes back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor
from torch.nn import functional

from .interface import DensePredictions

PADDING_SRGB = 0.5


@dataclass(frozen=True)
class Letterbox:
    """How (height, width) images sit inside the (size, size) square: scaled evenly, grey around.

    Attributes:
        height, width: of the image, pixels.
        size: of the square, pixels.
        centered: in the middle of the square, its sides rounded; otherwise in the top left corner, rounded down, which
            is how YOLOX was trained.
        padding_srgb: the grey around.
    """

    height: int
    width: int
    size: int
    centered: bool = True
    padding_srgb: float = PADDING_SRGB

    @property
    def inner(self) -> tuple[int, int]:
        """(height, width) of the image inside the square, pixels."""
        scale = self.size / max(self.height, self.width)
        whole = round if self.centered else int
        return max(1, whole(self.height * scale)), max(1, whole(self.width * scale))

    @property
    def corner(self) -> tuple[int, int]:
        """(top, left) of the image inside the square, pixels."""
        height, width = self.inner if self.centered else (self.size, self.size)
        return (self.size - height) // 2, (self.size - width) // 2

    def fit(self, images: Tensor) -> Tensor:
        """(B, 3, height, width) sRGB -> (B, 3, size, size); untouched when it already fits. Differentiable."""
        if (self.height, self.width) == (self.size, self.size):
            return images
        (height, width), (top, left) = self.inner, self.corner
        if (height, width) != (self.height, self.width):
            images = functional.interpolate(images, size=(height, width), mode="bilinear", align_corners=False)
        margins = (left, self.size - width - left, top, self.size - height - top)
        return functional.pad(images, margins, value=self.padding_srgb) if any(margins) else images

    def predict(self, images: Tensor, square: Callable[[Tensor], DensePredictions]) -> DensePredictions:
        """What ``square`` sees in the fitted images, its boxes mapped back."""
        found = square(self.fit(images))
        found.boxes = self.boxes_to_image(found.boxes)
        return found

    def boxes_to_image(self, boxes: Tensor) -> Tensor:
        """(..., 4) xyxy boxes, pixels of the square -> pixels of the image."""
        (height, width), (top, left) = self.inner, self.corner
        shift = boxes.new_tensor([left, top, left, top])
        scale_x, scale_y = self.width / width, self.height / height
        return (boxes - shift) * boxes.new_tensor([scale_x, scale_y, scale_x, scale_y])
