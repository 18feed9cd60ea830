"""What changed between two assessments of one battery beyond chance: a detector before and after, or two detectors.

Both were judged on the same places, and their resamples draw the same ones: the difference in each resample is paired,
so its interval is narrower than that of two figures which are only laid side by side.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..contract import RaucaError
from .assessment import Assessment, Score
from .bootstrap import interval

PAINTS = ("clean", "random", "transfer", "white_box")


@dataclass(frozen=True)
class Change:
    """Of AP@0.5 in one kind of paint.

    Attributes:
        paint: one of :data:`PAINTS`.
        difference: ``after - before``, with its 95 % interval over places.
    """

    paint: str
    before: float
    after: float
    low: float
    high: float

    @property
    def difference(self) -> float:
        return self.after - self.before

    @property
    def beyond_chance(self) -> bool:
        """The interval leaves no change out."""
        return self.low > 0 or self.high < 0


def changes(before: Assessment, after: Assessment) -> tuple[Change, ...]:
    """The change of every figure that both have.

    Raises:
        RaucaError: they are of different batteries, budgets, vehicles or numbers of resamples, so that no difference
            between them could be told from that of the views.
    """
    for name in ("battery", "budget", "vehicles"):
        one, other = getattr(before, name), getattr(after, name)
        if one != other:
            raise RaucaError(
                f"--before: that assessment is of {name} {one}, this one of {other}; assess both on the same"
            )
    found = []
    for paint in PAINTS:
        old, new = getattr(before, paint), getattr(after, paint)
        if isinstance(old, Score) and isinstance(new, Score):
            found.append(Change(paint, old.ap, new.ap, *_interval(before, after, paint)))
    return tuple(found)


def _interval(before: Assessment, after: Assessment, paint: str) -> tuple[float, float]:
    old, new = np.array(before.draws[paint]), np.array(after.draws[paint])
    if old.shape != new.shape:
        raise RaucaError(
            f"--before: {len(old)} resamples there, {len(new)} here; assess both with the same --resamples"
        )
    return interval(new - old)
