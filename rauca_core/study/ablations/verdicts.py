"""What became of each ordering that somebody claims: confirmed, refuted or undecided."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from ..results import Estimate
from .experiment import Claim
from .paired import Scores

Outcome = Literal["confirmed", "refuted", "undecided"]


@dataclass(frozen=True)
class Comparison:
    """Two rows on the same frames; ``gap`` is AP of the claimed worse minus AP of the claimed better.

    ``by_scope`` holds the gap of parts: each set of weathers, and the detectors that were attacked.
    """

    better: str
    worse: str
    gap: Estimate
    by_scope: Mapping[str, Estimate]

    @property
    def outcome(self) -> Outcome:
        """By the 95 % interval of the gap: all above 0, all below, or neither."""
        if self.gap.low > 0:
            return "confirmed"
        return "refuted" if self.gap.high < 0 else "undecided"


@dataclass(frozen=True)
class Verdict:
    """A claim and its comparisons, a pair each."""

    claim: Claim
    comparisons: tuple[Comparison, ...]

    @property
    def outcome(self) -> Outcome:
        """Confirmed if every pair is, refuted if one is."""
        outcomes = {comparison.outcome for comparison in self.comparisons}
        if "refuted" in outcomes:
            return "refuted"
        return "undecided" if "undecided" in outcomes else "confirmed"

    def sentence(self, titles: Mapping[str, str]) -> str:
        """One line: what was claimed and by whom, the outcome, the gap that decides it.

        Args:
            titles: of rows, by key.
        """
        better = dict.fromkeys(titles[one.better] for one in self.comparisons)
        worse = dict.fromkeys(titles[one.worse] for one in self.comparisons)
        deciding = (one for one in self.comparisons if one.outcome == self.outcome)
        least = min(deciding, key=lambda one: one.gap.low)
        which = f", least of {titles[least.better]} to {titles[least.worse]}," if len(self.comparisons) > 1 else ""
        gap = f"{least.gap.ap:+.3f} [{least.gap.low:+.3f}, {least.gap.high:+.3f}]"
        claim = f"{_listed(list(better))} below {_listed(list(worse))}"
        return f"{claim}: {self.outcome}; AP{which} apart by {gap} ({self.claim.by}'s claim)"


def judge(claims: Sequence[Claim], scores: Scores, detectors: Sequence[str], attacked: Sequence[str]) -> list[Verdict]:
    """Decide claims whose rows were all measured.

    Args:
        detectors: whose mean AP decides, over all sets of weathers.
        attacked: white boxes among the measured detectors.
    """
    rows = set(scores.curves[scores.weathers[0]])
    return [
        Verdict(
            claim, tuple(_compare(better, worse, scores, detectors, attacked) for better, worse in _pairs(claim, rows))
        )
        for claim in claims
        if all(any(key in rows for key in keys) for keys in (claim.better, claim.worse))
    ]


def _pairs(claim: Claim, rows: set[str]) -> list[tuple[str, str]]:
    return [(b, w) for b in claim.better for w in claim.worse if b in rows and w in rows]


def _compare(better: str, worse: str, scores: Scores, detectors: Sequence[str], attacked: Sequence[str]) -> Comparison:
    every = scores.weathers
    scopes = {name: scores.difference(worse, better, detectors, [name]) for name in every if len(every) > 1}
    if attacked:
        scopes["white box"] = scores.difference(worse, better, attacked, every)
    return Comparison(better, worse, scores.difference(worse, better, detectors, every), scopes)


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
