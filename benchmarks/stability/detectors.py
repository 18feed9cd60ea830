"""A differentiable detector that takes milliseconds, and answers that losses are afraid of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor, nn

from rauca_core.detect import DensePredictions, Detections

Answer = Callable[[DensePredictions], DensePredictions]
Box = tuple[float, float, float, float]


class FirstLayer(nn.Module):
    def __init__(self, weight: Tensor) -> None:
        super().__init__()
        self.weight = weight

    def forward(self, images: Tensor) -> Tensor:
        return nn.functional.conv2d(images, self.weight.to(images), stride=8).tanh()


class SmallDetector:
    """Two seeded convolutions that predict a box, objectness and two classes per cell: numerics, not sight."""

    name = "small"
    fingerprint = "0123"
    class_names: tuple[str, ...] = ("boat", "car")

    def __init__(self) -> None:
        generator = torch.Generator().manual_seed(0)
        self.first = FirstLayer(torch.randn(8, 3, 8, 8, generator=generator) * 0.1)
        self._second = torch.randn(7, 8, 3, 3, generator=generator) * 0.2

    def to(self, device: torch.device | str) -> SmallDetector:
        return self

    def dense(self, images: Tensor) -> DensePredictions:
        hidden = self.first(images)
        out = torch.nn.functional.conv2d(hidden, self._second.to(images), padding=1)
        batch, _, rows, columns = out.shape
        y, x = torch.meshgrid(*(torch.arange(n, device=out.device) * 8.0 + 4 for n in (rows, columns)), indexing="ij")
        center = torch.stack([x, y]) + 4 * out[:, 0:2].tanh()
        half = 16 * torch.exp(out[:, 2:4])
        boxes = torch.cat([center - half, center + half], 1).reshape(batch, 4, -1).transpose(1, 2)
        objectness = out[:, 4].reshape(batch, -1).sigmoid()
        return DensePredictions(boxes, objectness, out[:, 5:7].reshape(batch, 2, -1).transpose(1, 2).sigmoid())

    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        raise NotImplementedError("the optimizer reads predictions before suppression")


class Answering(SmallDetector):
    """The small detector, its predictions changed before anyone sees them; its attention can be read."""

    def __init__(self, answer: Answer) -> None:
        super().__init__()
        self._answer, self.attention_layer = answer, self.first

    def dense(self, images: Tensor) -> DensePredictions:
        return self._answer(super().dense(images))


def as_found(found: DensePredictions) -> DensePredictions:
    return found


def nothing(found: DensePredictions) -> DensePredictions:
    return DensePredictions(found.boxes[:, :0], found.objectness[:, :0], found.classes[:, :0])


def unseen(found: DensePredictions) -> DensePredictions:
    """Probabilities that a sigmoid rounds to 0, of float64 too."""
    return DensePredictions(found.boxes, (found.objectness - 1000).sigmoid(), (found.classes - 1000).sigmoid())


def elsewhere(found: DensePredictions) -> DensePredictions:
    return replace(found, boxes=found.boxes + 1e4)


def inside_out(found: DensePredictions) -> DensePredictions:
    return replace(found, boxes=found.boxes.roll(2, -1))


def points(found: DensePredictions) -> DensePredictions:
    return replace(found, boxes=found.boxes[..., :2].repeat(1, 1, 2))


def endless(found: DensePredictions) -> DensePredictions:
    """Boxes whose exponential overflows: sides from minus to plus infinity, beside one that is fine."""
    blown_up = (found.boxes[:, 1:] - found.boxes[:, 1:].mean(-1, keepdim=True)) * 1e38 * 1e3
    return replace(found, boxes=torch.cat([found.boxes[:, :1], blown_up], 1))


def saturated(box: Box, found: DensePredictions) -> DensePredictions:
    """A box in the very place, and probabilities that a sigmoid rounds to 1, of float64 too."""
    boxes = torch.tensor(box).to(found.boxes) + 0.0 * found.boxes
    return DensePredictions(boxes, (found.objectness + 40).sigmoid(), (found.classes + 40).sigmoid())


def sure(box: Box, found: DensePredictions) -> DensePredictions:
    """The same, but with the slope of the whole picture's objectness: Eq. 6 is at its steepest there."""

    def one(values: Tensor) -> Tensor:
        mean = values.mean(1, keepdim=True).expand_as(values)
        return mean - mean.detach() + 1.0

    boxes = torch.tensor(box).to(found.boxes) + 0.0 * found.boxes
    return DensePredictions(boxes, one(found.objectness), one(found.classes))
