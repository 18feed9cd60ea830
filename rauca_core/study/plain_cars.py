"""The shipped pictures of plain cars that a detector is shown before anything is rendered, and what it sees of them.

`tools/preflight_pictures.py` made them, in a town that nothing else uses; they are no part of any battery::

    assets/preflight/pictures.json     the box of the car in each picture
    assets/preflight/<picture>.jpg     sRGB
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Box
from ..contract.assets import assets_folder
from ..contract.schema import Record, read_json
from ..detect import Detections, Detector
from ..runtime.images import read_image
from .average_precision import Sample, best_score


@dataclass(frozen=True)
class PlainCar(Record):
    """A picture, and the tight box of the car in it (xyxy, pixels)."""

    file: Annotated[str, "plain_name"]
    box_xyxy: Box


@dataclass(frozen=True)
class PlainCars(Record):
    """All of them, and the command that made them; pictures of the vehicles alternate."""

    FORMAT = ("rauca-plain-cars", 1)

    made: str
    pictures: tuple[PlainCar, ...]


def plain_cars() -> tuple[Tensor, NDArray[np.float64]]:
    """Plain cars that every usual detector finds.

    Returns:
        images (N, 3, H, W) sRGB in [0, 1], and the boxes of the cars (N, 4) xyxy, pixels.

    Raises:
        RaucaError: a file is missing or damaged.
    """
    folder = assets_folder() / "preflight"
    known = PlainCars.from_json(read_json(folder / "pictures.json")).pictures
    pixels = np.stack([read_image(folder / one.file) for one in known])
    images = torch.from_numpy(np.ascontiguousarray(pixels.transpose(0, 3, 1, 2))).float() / 255
    return images, np.array([one.box_xyxy for one in known], np.float64)


Reading = Callable[[Tensor], Tensor]
"""From what a detector calls boxes (M, 4) to xyxy in pixels."""


@dataclass(frozen=True, eq=False)
class Look:
    """What a detector said of N pictures of ``size`` pixels a side, each with one car.

    Attributes:
        truths: (N, 4) xyxy, pixels.
        milliseconds: an image, the median.
    """

    size: int
    truths: NDArray[np.float64]
    said: list[Detections]
    milliseconds: float

    @staticmethod
    def at(detector: Detector, images: Tensor, truths: NDArray[np.float64]) -> Look:
        """Look at sRGB images (N, 3, H, W) in [0, 1], one by one."""
        said, spent = [], []
        for image in images:
            began = time.perf_counter()
            (one,) = detector.detect(image[None])
            spent.append(1000 * (time.perf_counter() - began))
            said.append(Detections(one.boxes.detach().cpu(), one.scores.detach().cpu(), one.labels.detach().cpu()))
        return Look(images.shape[-1], truths[: len(images)], said, statistics.median(spent))

    def samples(self, label: int, read: Reading = lambda boxes: boxes) -> list[Sample]:
        """Of the cars as one class, for average precision."""
        said = [(read(one.boxes.double()), one.scores.double(), one.labels == label) for one in self.said]
        return [
            Sample(truth, boxes[chosen].numpy(), scores[chosen].numpy())
            for truth, (boxes, scores, chosen) in zip(self.truths, said, strict=True)
        ]

    def scores(self, label: int, read: Reading = lambda boxes: boxes) -> NDArray[np.float64]:
        """(N,) the best score of the class on each car, 0 where nothing overlaps it by half."""
        return np.array([best_score(sample) for sample in self.samples(label, read)])

    def found(self, label: int, threshold: float, read: Reading = lambda boxes: boxes) -> int:
        """Cars that are found as a class at a score."""
        return int((self.scores(label, read) >= threshold).sum())

    def best_label(self, threshold: float) -> tuple[int, int]:
        """The class that most cars are found as, and how many; -1 where nothing is said at all."""
        labels = sorted({int(label) for one in self.said for label in one.labels.unique()})
        best = max(labels, key=lambda label: self.found(label, threshold), default=-1)
        return best, self.found(best, threshold)

    def middling(self, label: int) -> int:
        """The picture of the median score: one that is as certain as 1.0 can hold has no slope left."""
        return int(np.argsort(self.scores(label), kind="stable")[len(self.truths) // 2])
