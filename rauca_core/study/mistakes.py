"""What a detector gets wrong at the score that it is deployed with, each wrong thing counted once under one cause.

Average precision integrates over all scores; an engineer deploys one. At that one, two kinds of things are wrong: a
target that is not found, and a detection of the target's class that finds nothing new. Each is given one cause, in the
spirit of TIDE (Bolya et al., ECCV 2020), so that the causes sum exactly to what is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ..contract.schema import Record
from ..detect.found import Found
from .average_precision import IOU_THRESHOLD, box_overlaps

TOUCHES = 0.1  # a box that overlaps the target less than this is about something else (TIDE's background threshold)


@dataclass(frozen=True)
class Mistakes(Record):
    """Counts over some images with one target each.

    Attributes:
        targets: how many there were.
        found: of these, by a detection of the right class that overlaps by at least one half.
        missed: not found, and nothing below explains it.
        wrong_class: not found, but a detection of another class lies there.
        badly_placed: detections of the right class that overlap the target by less than one half; where the target was
            not found, the first of them stands for it.
        seen_twice: further detections of a target that was found.
        invented: detections of the right class away from the target.
    """

    targets: int = 0
    found: int = 0
    missed: int = 0
    wrong_class: int = 0
    badly_placed: int = 0
    seen_twice: int = 0
    invented: int = 0

    @property
    def wrong(self) -> int:
        """All that is wrong: the sum of the causes."""
        return self.missed + self.wrong_class + self.badly_placed + self.seen_twice + self.invented

    @property
    def recall(self) -> float:
        """Share of the targets that were found; 0 without any."""
        return self.found / self.targets if self.targets else 0.0

    def __add__(self, other: Mistakes) -> Mistakes:
        return Mistakes(*(getattr(self, one.name) + getattr(other, one.name) for one in fields(self)))


def mistakes_in(found: Found, truth: NDArray[np.float64], category: str, threshold: float) -> Mistakes:
    """What is wrong in one image.

    Args:
        found: its detections, of all classes.
        truth: (4,) xyxy box of the target, pixels.
        category: the target's class, by its canonical name.
        threshold: lowest score of a detection that counts.
    """
    deployed = found.scores >= threshold
    right = np.array([name == category for name in found.names], bool)
    overlaps = box_overlaps(found.boxes, truth)
    on_target, touching = overlaps >= IOU_THRESHOLD, overlaps >= TOUCHES
    hits = int((deployed & right & on_target).sum())
    near = int((deployed & right & touching & ~on_target).sum())
    away = int((deployed & right & ~touching).sum())
    if hits:
        return Mistakes(1, found=1, badly_placed=near, seen_twice=hits - 1, invented=away)
    if (deployed & ~right & on_target).any():
        return Mistakes(1, wrong_class=1, badly_placed=near, invented=away)
    return Mistakes(1, missed=int(not near), badly_placed=near, invented=away)
