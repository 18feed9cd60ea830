"""What a hardened detector says of everything but the vehicle, and how sure that is.

One object stands in a picture of each paint and so counts many times, but it is no more than one object. What is drawn
is the place, as for average precision (`intervals.py`): the interval of a share is over places that show other objects.
Often one of them holds all that the detectors differ on, and the share is 1 without it. On the logit scale that is an
outlier of any size, so these shares stay as they are. As places are all that is drawn, no standard error is believed
that is below a quarter of one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..contract import read_plan
from ..detect.agreement import Agreement, agreement_of
from .detecting import Pictures
from .detection_cache import DetectionCache
from .intervals import Places, difference_interval
from .results import Estimate
from .study import Entry


@dataclass(frozen=True)
class FrameAgreement:
    """Both detectors on one frame.

    Attributes:
        town, location: the place.
        vacant: without the vehicle.
        beside: on the other objects beside it, in every paint.
    """

    town: int
    location: int
    vacant: Agreement
    beside: Agreement

    @property
    def place(self) -> tuple[int, int]:
        return self.town, self.location

    @property
    def both(self) -> Agreement:
        return self.vacant + self.beside


@dataclass(frozen=True)
class OtherClasses:
    """Both detectors on some frames."""

    frames: tuple[FrameAgreement, ...]

    @property
    def vacant(self) -> Agreement:
        """On pictures without the vehicle."""
        return sum((frame.vacant for frame in self.frames), Agreement())

    @property
    def beside(self) -> Agreement:
        """On the other objects in pictures with the vehicle."""
        return sum((frame.beside for frame in self.frames), Agreement())

    @property
    def both(self) -> Agreement:
        """On all of them."""
        return self.vacant + self.beside

    @property
    def showing(self) -> tuple[FrameAgreement, ...]:
        """The frames in which either detector was sure of another object."""
        return tuple(frame for frame in self.frames if frame.both.objects)

    @property
    def places(self) -> int:
        """How many places show other objects."""
        return len({frame.place for frame in self.showing})

    @property
    def estimate(self) -> Estimate | None:
        """The share that agrees, with its 95 % interval; it reaches from 0 to 1 where all objects are in one place.

        None where neither detector was sure of anything.
        """
        some = self.showing
        if not some:
            return None
        each, share = [frame.both for frame in some], self.both.agreed / self.both.objects
        if self.places < 2:
            return Estimate(share, 0.0, 1.0)
        places = Places.in_towns([frame.place for frame in some])
        counts = places.left_out()[:, places.of_frame]
        agreed, objects = counts @ [one.agreed for one in each], counts @ [one.objects for one in each]
        return Estimate(share, *difference_interval(agreed / objects, places.count, (0.0, 1.0)))

    def told(self) -> dict[str, Any]:
        """As JSON."""
        share, both = self.estimate, self.both
        return {
            "agreement": share and share.ap, "low": share and share.low, "high": share and share.high,
            "agreed": both.agreed, "objects": both.objects, "kept": both.kept, "known": both.known,
            "views": len(self.showing), "places": self.places,
        }  # fmt: skip

    @staticmethod
    def together(several: Iterable[OtherClasses]) -> OtherClasses:
        """All frames of several."""
        return OtherClasses(tuple(frame for one in several for frame in one.frames))


def other_classes_of(
    entry: Entry, before: str, after: str, vacant: Pictures, seen: tuple[DetectionCache, DetectionCache]
) -> OtherClasses:
    """Of two detectors on an entry's views.

    Args:
        before, after: the detectors' names.
        vacant: the views without their vehicle, in the order of the entry's frames.
        seen: what each detected there.
    """
    assert entry.views is not None
    town, (one, other) = read_plan(entry.views).seed, seen
    return OtherClasses(tuple(
        FrameAgreement(
            town, row.location, agreement_of([(one[image], other[image], None)]),
            _beside(entry, before, after, index, row.box_xyxy),
        )
        for index, (row, image) in enumerate(zip(entry.results.frames, vacant.hashes, strict=True))
    ))  # fmt: skip


def _beside(entry: Entry, before: str, after: str, index: int, box: Sequence[float]) -> Agreement:
    """On the other objects in a frame, in every paint."""
    vehicle = np.array(box, np.float64)
    return agreement_of(
        (entry.recorded.found(before, paint, index), entry.recorded.found(after, paint, index), vehicle)
        for paint in entry.results.paints
    )
