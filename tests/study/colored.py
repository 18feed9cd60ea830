"""A detector that goes by color, and vehicles in colors: detections that are known before they are made."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from rauca_core.contract import Dataset
from rauca_core.contract.files import png_bytes, write_bytes
from rauca_core.detect import DensePredictions, Detections

SIZE = 64
RED, BLUE, GREEN = (220, 20, 20), (20, 20, 220), (20, 220, 20)


class FindsColors:
    """A detector that takes what has one of its colors for a car."""

    class_names = ("car",)

    def __init__(self, name: str, *colors: tuple[int, int, int]) -> None:
        self.name, self.colors, self.fingerprint = name, colors, f"f00d{len(colors)}"

    def to(self, device: torch.device | str) -> FindsColors:
        return self

    def dense(self, images: Tensor) -> DensePredictions:
        raise NotImplementedError

    def detect(self, images: Tensor, score_threshold: float = 0.0, iou_threshold: float = 0.45) -> list[Detections]:
        return [self._detect(image) for image in images]

    def _detect(self, image: Tensor) -> Detections:
        known = [(image - torch.tensor(c)[:, None, None] / 255).abs().amax(0) < 0.02 for c in self.colors]
        rows, columns = torch.stack(known).any(0).nonzero().unbind(1)
        if not len(rows):
            return Detections(torch.zeros(0, 4), torch.zeros(0), torch.zeros(0, dtype=torch.int64))
        box = torch.stack([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]).float()
        return Detections(box[None], torch.tensor([0.9]), torch.tensor([0]))


def paint(dataset: Dataset, folder: Path, colors: list[tuple[int, int, int]]) -> None:
    """Write ``<frame id>.png`` of each frame: black, but for its box."""
    for frame, color in zip(dataset.frames(), colors, strict=True):
        pixels = np.zeros((SIZE, SIZE, 3), np.uint8)
        left, top, right, bottom = (int(v) for v in frame.box_xyxy)
        pixels[top:bottom, left:right] = color
        write_bytes(folder / f"{frame.id}.png", png_bytes(pixels))
