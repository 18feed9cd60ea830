"""Whether a hardened detector still says what it said of everything but the vehicle: of pictures without one, and of
the other objects in pictures with one.

An object that either detector is sure of (score of at least .5) counts as agreed if the other one finds it, of the same
class, by an overlap of at least .5 and with half that score: what stands at the threshold is no disagreement. Objects
that only the hardened detector finds count against it so; what it forgot is told apart.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from .found import Found
from .nms import box_iou, share_within

SURE, SEEN, OVERLAP = 0.5, 0.25, 0.5
INSIDE = 0.5  # of an object's area in the vehicle's box, from which on it is the vehicle, or a part of it


@dataclass(frozen=True)
class Agreement:
    """Of how many objects that either detector is sure of the other one says the same.

    Attributes:
        agreed, objects: of so many, in both directions.
        kept, known: the same of what the first detector is sure of, alone.
    """

    agreed: int = 0
    objects: int = 0
    kept: int = 0
    known: int = 0

    @property
    def share(self) -> float | None:
        """None where nobody was sure of anything."""
        return self.agreed / self.objects if self.objects else None

    @property
    def kept_share(self) -> float | None:
        """Of what the first detector was sure of; None where it was of nothing."""
        return self.kept / self.known if self.known else None

    def __add__(self, other: Agreement) -> Agreement:
        agreed, objects = self.agreed + other.agreed, self.objects + other.objects
        return Agreement(agreed, objects, self.kept + other.kept, self.known + other.known)


def agreement_of(pairs: Iterable[tuple[Found, Found, NDArray[np.float64] | None]]) -> Agreement:
    """Over pictures: what both detectors found, and the vehicle's box (4,) xyxy, pixels, if it is there."""
    total = Agreement()
    for one, other, vehicle in pairs:
        (kept, known), (found_before, found) = _seen_by(one, other, vehicle), _seen_by(other, one, vehicle)
        total = total + Agreement(kept + found_before, known + found, kept, known)
    return total


def _seen_by(one: Found, other: Found, vehicle: NDArray[np.float64] | None) -> tuple[int, int]:
    """How many of one detector's sure objects in a picture the other one finds, and how many these objects are."""
    beside = one.scores >= SURE
    if vehicle is not None:
        beside &= (share_within(torch.from_numpy(one.boxes), torch.from_numpy(vehicle)[None]) < INSIDE)[:, 0].numpy()
    sure = np.flatnonzero(beside)
    if not len(sure):
        return 0, 0
    seen = np.flatnonzero(other.scores >= SEEN)
    overlaps = box_iou(torch.from_numpy(one.boxes[sure]), torch.from_numpy(other.boxes[seen])).numpy()
    same = np.array([[one.names[i] == other.names[k] for k in seen] for i in sure], bool).reshape(overlaps.shape)
    return int(((overlaps >= OVERLAP) & same).any(1).sum()), len(sure)
