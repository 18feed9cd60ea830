"""What changed between two assessments of one battery beyond chance: a detector before and after, or two detectors.

Both were judged in the same places: the difference is taken with all of them and without each, so its interval is
narrower than that of two figures which are only laid side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..contract import RaucaError
from .assessment import PAINTS, Assessment, Score
from .intervals import CONFIDENCE, chance_of, difference_interval, holm

WHITE_BOX = "white_box"


@dataclass(frozen=True)
class Change:
    """Of AP@0.5 in one kind of paint.

    Attributes:
        paint: one of :data:`assessment.PAINTS`.
        low, high: the 95 % interval of ``difference``, over places.
        chance: how likely so large a difference is where there is none, corrected for how many are looked at.
    """

    paint: str
    before: float
    after: float
    low: float
    high: float
    chance: float

    @property
    def difference(self) -> float:
        """``after - before``."""
        return self.after - self.before

    @property
    def decided(self) -> bool:
        """Whether places are all that chance has a hand in: each detector has a white-box camouflage of its own, and
        how well one attack goes is luck that places do not show."""
        return self.paint != WHITE_BOX

    @property
    def beyond_chance(self) -> bool:
        return self.decided and self.chance <= 1 - CONFIDENCE


def changes(before: Assessment, after: Assessment) -> tuple[Change, ...]:
    """The change of every figure that both have, as one family of claims; errors as of :func:`change_in`."""
    return corrected([change_in(paint, before, after) for paint in PAINTS if _have(paint, before, after)])


def change_in(paint: str, before: Assessment, after: Assessment) -> Change:
    """The change of one figure that both have, its chance not yet corrected.

    Raises:
        RaucaError: they are of different batteries, budgets, vehicles or places, so that no difference between them
            could be told from that of the views.
    """
    old, new = before.without_place[paint], after.without_place[paint]
    compared = [(name, getattr(before, name), getattr(after, name)) for name in ("battery", "budget", "vehicles")]
    for name, one, other in [*compared, ("so many places:", len(old), len(new))]:
        if one != other:
            raise RaucaError(
                f"--before: that assessment is of {name} {one}, this one of {other}; assess both on the same"
            )
    ends = getattr(before, paint).ap, getattr(after, paint).ap
    curve = np.array([ends[1], *new]) - np.array([ends[0], *old])
    frames = before.clean.frames
    return Change(paint, *ends, *difference_interval(curve, frames), chance_of(curve, frames))


def corrected(found: Sequence[Change]) -> tuple[Change, ...]:
    """The same changes as one family of claims."""
    chances = iter(holm([one.chance for one in found if one.decided]))
    return tuple(replace(one, chance=next(chances)) if one.decided else one for one in found)


def _have(paint: str, *assessments: Assessment) -> bool:
    return all(isinstance(getattr(one, paint), Score) for one in assessments)
