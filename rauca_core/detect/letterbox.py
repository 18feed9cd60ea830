"""Fit an image of any size into the detector's input, and map boxes back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torch import Tensor
from torch.nn import functional

from .interface import DensePredictions

PADDING_SRGB = 0.5


@dataclass(frozen=True)
class Letterbox:
    """How (height, width) images sit inside the network's input: scaled evenly, grey around.

    Attributes:
        height, width: of the image, pixels.
        size: of the input, pixels: a square's side, or (height, width).
        centered: in the middle of the input, its sides rounded; otherwise in the top left corner, rounded down, which
            is how YOLOX was trained.
        padding_srgb: the grey around.
        stretched: scaled unevenly to fill the input instead.
    """

    height: int
    width: int
    size: int | tuple[int, int]
    centered: bool = True
    padding_srgb: float = PADDING_SRGB
    stretched: bool = False

    @property
    def target(self) -> tuple[int, int]:
        """(height, width) of the input, pixels."""
        return (self.size, self.size) if isinstance(self.size, int) else self.size

    @property
    def inner(self) -> tuple[int, int]:
        """(height, width) of the image inside the input, pixels."""
        if self.stretched:
            return self.target
        scale = min(self.target[0] / self.height, self.target[1] / self.width)
        whole = round if self.centered else int
        return max(1, whole(self.height * scale)), max(1, whole(self.width * scale))

    @property
    def corner(self) -> tuple[int, int]:
        """(top, left) of the image inside the input, pixels."""
        height, width = self.inner if self.centered else self.target
        return (self.target[0] - height) // 2, (self.target[1] - width) // 2

    def fit(self, images: Tensor) -> Tensor:
        """(B, 3, height, width) sRGB -> (B, 3, *target); untouched when it already fits. Differentiable."""
        if (self.height, self.width) == self.target:
            return images
        (height, width), (top, left) = self.inner, self.corner
        if (height, width) != (self.height, self.width):
            images = functional.interpolate(images, size=(height, width), mode="bilinear", align_corners=False)
        margins = (left, self.target[1] - width - left, top, self.target[0] - height - top)
        return functional.pad(images, margins, value=self.padding_srgb) if any(margins) else images

    def predict(self, images: Tensor, inside: Callable[[Tensor], DensePredictions]) -> DensePredictions:
        """What ``inside`` sees in the fitted images, its boxes mapped back."""
        found = inside(self.fit(images))
        found.boxes = self.boxes_to_image(found.boxes)
        return found

    def boxes_to_image(self, boxes: Tensor) -> Tensor:
        """(..., 4) xyxy boxes, pixels of the input -> pixels of the image."""
        (height, width), (top, left) = self.inner, self.corner
        shift = boxes.new_tensor([left, top, left, top])
        scale_x, scale_y = self.width / width, self.height / height
        return (boxes - shift) * boxes.new_tensor([scale_x, scale_y, scale_x, scale_y])
