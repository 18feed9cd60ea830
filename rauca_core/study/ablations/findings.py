"""What an ablation found: rows compared in the same places, and what became of each ordering that somebody claims.

Differences are paired: all variants share the resamples. A variant that was optimized with several seeds has as many
camouflages; its AP is their mean, and every resample draws seeds as well as places, so that an interval covers the luck
of an optimization too. With one seed it does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ...contract.seeding import named_rng
from ..candidates import NORMAL, RANDOM
from ..families import is_own
from ..results import Estimate
from ..scores import Curve, Recorded, estimate
from ..study import Entry, Study
from .experiment import Claim, Experiment, Variant

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


@dataclass(frozen=True, eq=False)
class Scores:
    """AP of every row of a table under every set of weathers, resampled together.

    Attributes:
        curves: ``curves[weathers][row][detector]``.
    """

    curves: Mapping[str, Mapping[str, Mapping[str, Curve]]]

    @property
    def weathers(self) -> tuple[str, ...]:
        return tuple(self.curves)

    @property
    def detectors(self) -> tuple[str, ...]:
        rows = self.curves[self.weathers[0]]
        return tuple(next(iter(rows.values())))

    def ap(self, row: str, detectors: Sequence[str], weathers: Sequence[str]) -> Estimate:
        """AP of a row, averaged over detectors and sets of weathers."""
        return estimate(self._mean(row, detectors, weathers))

    def difference(self, row: str, less: str, detectors: Sequence[str], weathers: Sequence[str]) -> Estimate:
        """AP of ``row`` minus that of ``less``, in the same places."""
        return estimate(self._mean(row, detectors, weathers) - self._mean(less, detectors, weathers))

    def _mean(self, row: str, detectors: Sequence[str], weathers: Sequence[str]) -> Curve:
        some = [self.curves[name][row][detector] for name in weathers for detector in detectors]
        return np.asarray(np.mean(some, axis=0))


def score_rows(entries: Sequence[Entry], rows: Mapping[str, Sequence[str]]) -> Scores:
    """Resample the AP of rows.

    Args:
        entries: one per set of weathers, of the same paints and detectors.
        rows: row -> its camouflages' paints in the results, one per seed.

    Raises:
        RaucaError: detections that the results count are not kept any more.
    """
    curves: dict[str, dict[str, dict[str, Curve]]] = {}
    for entry in entries:
        results, recorded = entry.results, Recorded(entry)
        for row, paints in rows.items():
            # (1 + R, S): how much each seed counts; equally at first, then as often as this row draws it.
            seeds, rng = len(paints), named_rng("seeds", row, results.seed)
            drawn = rng.multinomial(seeds, np.full(seeds, 1 / seeds), size=results.resamples)
            share = np.concatenate([np.ones((1, seeds)), drawn]) / seeds
            curves.setdefault(entry.weathers, {})[row] = {
                name: (share * np.stack([recorded.curve(name, paint) for paint in paints], 1)).sum(1)
                for name in results.detectors
            }
    return Scores(curves)


def judge(claims: Sequence[Claim], scores: Scores, detectors: Sequence[str], attacked: Sequence[str]) -> list[Verdict]:
    """Decide claims whose rows were all measured.

    Args:
        detectors: whose mean AP decides, over all sets of weathers.
        attacked: white boxes among the measured detectors.
    """
    every = scores.weathers
    known, verdicts = set(scores.curves[every[0]]), []

    def compare(better: str, worse: str) -> Comparison:
        scopes = {name: scores.difference(worse, better, detectors, [name]) for name in every if len(every) > 1}
        if attacked:
            scopes["white box"] = scores.difference(worse, better, attacked, every)
        return Comparison(better, worse, scores.difference(worse, better, detectors, every), scopes)

    for claim in claims:
        pairs = [(b, w) for b in claim.better for w in claim.worse if b in known and w in known]
        if pairs:
            verdicts.append(Verdict(claim, tuple(compare(*pair) for pair in pairs)))
    return verdicts


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


@dataclass(frozen=True)
class Findings:
    """An ablation's results.

    Attributes:
        experiment: which one.
        variants: those that took part.
        study: of all camouflages, an entry per set of weathers.
        paints: row (``normal``, ``random`` or a variant's key) -> its paints in the study, one per seed.
        attacked: detectors that the variants were optimized against.
        settings: row -> settings of its optimization that differ from the common ones.
        common: settings that all share.
        timings_s: stage -> seconds.
    """

    experiment: Experiment
    variants: tuple[Variant, ...]
    study: Study
    paints: Mapping[str, Sequence[str]]
    attacked: tuple[str, ...]
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    common: Mapping[str, Any] = field(default_factory=dict)
    timings_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def titles(self) -> dict[str, str]:
        """Row -> how tables call it."""
        return {NORMAL: "Normal", RANDOM: "Random", **{v.key: v.title for v in self.variants}}

    @property
    def seeds(self) -> int:
        """The most camouflages of a row."""
        return max(len(paints) for paints in self.paints.values())

    @property
    def titles_of_paints(self) -> dict[str, str]:
        """Paint of the study -> the title of its row, numbered where there are several seeds."""
        titles = self.titles
        return {
            paint: titles[row] if len(paints) == 1 else f"{titles[row]}, seed {number}"
            for row, paints in self.paints.items()
            for number, paint in enumerate(paints)
        }

    @property
    def detectors(self) -> list[str]:
        """Whose mean decides: those that were not trained on this project's images, if there are any."""
        names = list(self.study.entries[0].results.detectors)
        return [name for name in names if not is_own(name)] or names

    @property
    def white_box(self) -> list[str]:
        """Detectors that were attacked and measured."""
        return [name for name in self.study.entries[0].results.detectors if name in self.attacked]

    def scores(self) -> Scores:
        """AP of every row, resampled; reads the study's detections."""
        return score_rows(self.study.entries, self.paints)

    def verdicts(self, scores: Scores) -> list[Verdict]:
        """What became of the experiment's claims."""
        return judge(self.experiment.claims, scores, self.detectors, self.white_box)
