"""What every detector offers, whatever its family, and what it asks of the images it is given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor, nn

from ..contract import RaucaError

OVERLAP = 0.45  # of two boxes of a class, above which the less sure one is suppressed, where nobody says otherwise


@dataclass
class DensePredictions:
    """Predictions before non-maximum suppression, differentiable with respect to the image.

    Attributes:
        boxes: (B, N, 4) xyxy, pixels of the image that was passed in.
        objectness: (B, N) in [0, 1]; ones for detectors that have none.
        classes: (B, N, C) class probabilities in [0, 1], given an object.
    """

    boxes: Tensor
    objectness: Tensor
    classes: Tensor

    def to(self, dtype: torch.dtype) -> DensePredictions:
        """The same in another precision."""
        return DensePredictions(self.boxes.to(dtype), self.objectness.to(dtype), self.classes.to(dtype))


@dataclass
class Detections:
    """Final detections of one image, best first.

    Attributes:
        boxes: (M, 4) xyxy, pixels of the image that was passed in.
        scores: (M,) in [0, 1].
        labels: (M,) int64 indices into the detector's ``class_names``.
    """

    boxes: Tensor
    scores: Tensor
    labels: Tensor


class Detector(Protocol):
    """A detector. Letterboxing, channel order and input normalization are its own business.

    Attributes:
        name: as in tables, e.g. ``"yolov3-tiny"``.
        class_names: (C,) names, see :mod:`rauca_core.detect.classes`.
        fingerprint: hexadecimal; changes with anything that could change a prediction (weights, network, input size,
            class names), so that results may be kept on disk under it.
    """

    name: str
    class_names: tuple[str, ...]
    fingerprint: str

    def to(self, device: torch.device | str) -> Detector:
        """Move the network to a device; returns self."""
        ...

    def dense(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1]; gradients flow to ``images``.

        Raises:
            RaucaError: images of another shape, type or range, or with NaN; see :mod:`rauca_core.detect.interface`.
        """
        ...

    def detect(
        self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = OVERLAP
    ) -> list[Detections]:
        """Final detections per image after class-wise non-maximum suppression; no gradient.

        Raises:
            RaucaError: as :meth:`dense`.
        """
        ...


# Rounding of resampling and of half precision; a batch in 0..255 or a normalized one lies far outside.
RANGE_TOLERANCE = 1e-2


def check_images(name: str, images: Tensor, waits: bool = False) -> None:
    """Refuse what is not a batch of sRGB images (B, 3, H, W) in [0, 1]. Gradients are not touched.

    Args:
        name: the detector's, for the message.
        waits: the caller waits for the device anyway, so look at the values wherever they are.

    Raises:
        RaucaError: not a tensor of that shape, no pixels, not floating point, values out of range, NaN or infinite.
    """
    if not isinstance(images, Tensor):
        raise RaucaError(f"{name}: images must be a torch tensor, not {type(images).__name__}")
    if images.ndim != 4 or images.shape[1] != 3 or 0 in images.shape:
        raise RaucaError(f"{name}: images must have shape (B, 3, H, W), not {tuple(images.shape)}")
    if not images.dtype.is_floating_point:
        raise RaucaError(f"{name}: images must be sRGB in [0, 1] as floating point, not {images.dtype}; divide by 255")
    if waits or images.device.type == "cpu":
        _check_values(name, images.detach())


def in_type_of(network: nn.Module | None, images: Tensor) -> Tensor:
    """Images in the floating-point type that a network computes in, float32 where it says none; gradients flow."""
    parameters = () if network is None else network.parameters()
    return images.to(next((p.dtype for p in parameters if p.is_floating_point()), torch.float32))


def _check_values(name: str, images: Tensor) -> None:
    low, high = (float(value) for value in torch.stack(torch.aminmax(images)).tolist())
    if math.isnan(low) or math.isinf(low) or math.isinf(high):
        bad = (~torch.isfinite(images)).flatten(1).sum(1).tolist()
        first = next(index for index, count in enumerate(bad) if count)
        raise RaucaError(f"{name}: image {first} of the batch holds {bad[first]} NaN or infinite values")
    if low < -RANGE_TOLERANCE or high > 1 + RANGE_TOLERANCE:
        raise RaucaError(
            f"{name}: images must be sRGB in [0, 1], found values from {low:.3g} to {high:.3g}; "
            "adapters normalize themselves, pass neither 0..255 nor normalized images"
        )
