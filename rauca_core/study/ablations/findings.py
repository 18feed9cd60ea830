"""What an ablation found: rows compared in the same places, and what became of each ordering that somebody claims.

Differences are paired: all variants stand in the same places, and one seed of a variant is held against the same seed
of another. A variant that was optimized with several seeds has as many camouflages; its AP is their mean, and seeds are
a random effect beside places, so that an interval covers the luck of an optimization too. With one seed it does not,
with two to four hardly: nothing is called confirmed or refuted below five.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from ..candidates import NORMAL, RANDOM
from ..intervals import CONFIDENCE, SEEDS_NEEDED, Curve, Places, chance_of, holm
from ..parts import leading, parts_of
from ..results import Estimate
from ..scores import difference, estimate, places_of
from ..study import Entry, Study
from .experiment import Claim, Experiment, Variant

Outcome = Literal["confirmed", "refuted", "undecided"]


@dataclass(frozen=True)
class Comparison:
    """Two rows on the same frames; ``gap`` is AP of the claimed worse minus AP of the claimed better.

    Attributes:
        by_scope: the gap of parts: each set of weathers, and the detectors that were attacked.
        seeds: optimizations of each row.
        chance: how likely so large a gap is where there is none, corrected for all comparisons of the experiment.
    """

    better: str
    worse: str
    gap: Estimate
    by_scope: Mapping[str, Estimate]
    seeds: int = 1
    chance: float = 1.0

    @property
    def outcome(self) -> Outcome:
        """Undecided with fewer than five seeds, and where chance may well have made the gap."""
        if self.seeds < SEEDS_NEEDED or self.chance > 1 - CONFIDENCE:
            return "undecided"
        return "confirmed" if self.gap.ap > 0 else "refuted"


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

    @property
    def told(self) -> str:
        """The outcome, and why there is none where seeds are too few."""
        seeds = min(comparison.seeds for comparison in self.comparisons)
        if self.outcome != "undecided" or seeds >= SEEDS_NEEDED:
            return self.outcome
        return f"undecided: {seeds} {'seed' if seeds == 1 else 'seeds'}, {SEEDS_NEEDED} are needed"

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
        return f"{claim}: {self.told}; AP{which} apart by {gap} ({self.claim.by}'s claim)"


@dataclass(frozen=True, eq=False)
class Scores:
    """AP of every row of a table under every set of weathers, the same places left out of all.

    Attributes:
        curves: ``curves[weathers][row][detector]``, (S, 1 + C) for a row's S seeds.
        frames: under each set of weathers.
        given: rows that nobody optimized here, and that are what they are: they need no second seed.
    """

    curves: Mapping[str, Mapping[str, Mapping[str, Curve]]]
    frames: Mapping[str, int]
    given: frozenset[str] = frozenset((NORMAL, RANDOM))

    @property
    def weathers(self) -> tuple[str, ...]:
        return tuple(self.curves)

    @property
    def detectors(self) -> tuple[str, ...]:
        rows = self.curves[self.weathers[0]]
        return tuple(next(iter(rows.values())))

    def ap(self, row: str, detectors: Sequence[str], weathers: Sequence[str]) -> Estimate:
        """AP of a row, averaged over seeds, detectors and sets of weathers."""
        return estimate(self._mean(row, detectors, weathers), self._views(weathers))

    def difference(self, row: str, less: str, detectors: Sequence[str], weathers: Sequence[str]) -> Estimate:
        """AP of ``row`` minus that of ``less``, in the same places, seed by seed."""
        return difference(self._paired(row, less, detectors, weathers), self._views(weathers))

    def chance(self, row: str, less: str, detectors: Sequence[str], weathers: Sequence[str]) -> float:
        """How likely so large a difference is where there is none."""
        return chance_of(self._paired(row, less, detectors, weathers), self._views(weathers))

    def seeds(self, *rows: str) -> int:
        """The fewest optimizations of some rows, less those that are given."""
        any_curves = self.curves[self.weathers[0]]
        counts = [len(next(iter(any_curves[row].values()))) for row in rows if row not in self.given]
        return min(counts, default=SEEDS_NEEDED)

    def _paired(self, row: str, less: str, detectors: Sequence[str], weathers: Sequence[str]) -> Curve:
        """One seed less the same seed of the other; a row of a single camouflage stands against all of the other's."""
        one, other = self._mean(row, detectors, weathers), self._mean(less, detectors, weathers)
        both = min(len(one), len(other))
        return one - other if both == 1 else one[:both] - other[:both]

    def _mean(self, row: str, detectors: Sequence[str], weathers: Sequence[str]) -> Curve:
        some = [self.curves[name][row][detector] for name in weathers for detector in detectors]
        return np.asarray(np.mean(some, axis=0))

    def _views(self, weathers: Sequence[str]) -> int:
        return sum(self.frames[name] for name in weathers)


def score_rows(entries: Sequence[Entry], rows: Mapping[str, Sequence[str]]) -> Scores:
    """AP of rows with all places and without each.

    Args:
        entries: one per set of weathers, of the same paints and detectors, and in the same places.
        rows: row -> its camouflages' paints in the results, one per seed.

    Raises:
        RaucaError: detections that the results count are not kept any more.
    """
    every = [row for entry in entries for row in entry.results.frames]
    together, begin = places_of(every), 0
    curves: dict[str, dict[str, dict[str, Curve]]] = {}
    for entry in entries:
        results = entry.results
        own = Places(together.kind, together.of_frame[begin : begin + len(results.frames)], together.count)
        begin += len(results.frames)
        curves[entry.weathers] = {
            row: {
                name: np.stack([entry.recorded.curve(name, paint, own) for paint in paints])
                for name in results.detectors
            }
            for row, paints in rows.items()
        }
    return Scores(curves, {entry.weathers: len(entry.results.frames) for entry in entries})


def judge(claims: Sequence[Claim], scores: Scores, detectors: Sequence[str], attacked: Sequence[str]) -> list[Verdict]:
    """Decide claims whose rows were all measured, as one family: each pair's chance is corrected for all pairs.

    Args:
        detectors: whose mean AP decides, over all sets of weathers.
        attacked: white boxes among the measured detectors.
    """
    every = scores.weathers
    known = set(scores.curves[every[0]])
    pairs = [[(b, w) for b in claim.better for w in claim.worse if b in known and w in known] for claim in claims]
    chances = iter(holm([scores.chance(w, b, detectors, every) for some in pairs for b, w in some]))

    def compare(better: str, worse: str) -> Comparison:
        scopes = {name: scores.difference(worse, better, detectors, [name]) for name in every if len(every) > 1}
        if attacked:
            scopes["white box"] = scores.difference(worse, better, attacked, every)
        gap, seeds = scores.difference(worse, better, detectors, every), scores.seeds(better, worse)
        return Comparison(better, worse, gap, scopes, seeds, next(chances))

    return [
        Verdict(claim, tuple(compare(*pair) for pair in some))
        for claim, some in zip(claims, pairs, strict=True)
        if some
    ]


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
        """Whose mean decides: those farthest from the attacks, see `parts.py`."""
        return leading(self.parts)[1]

    @property
    def parts(self) -> dict[str, list[str]]:
        """The detectors by their part in the attacks."""
        return parts_of(list(self.study.entries[0].results.detectors), self.attacked)

    @property
    def white_box(self) -> list[str]:
        """Detectors that were attacked and measured."""
        return [name for name in self.study.entries[0].results.detectors if name in self.attacked]

    def scores(self) -> Scores:
        """AP of every row, with all places and without each; reads the study's detections."""
        return score_rows(self.study.entries, self.paints)

    def verdicts(self, scores: Scores) -> list[Verdict]:
        """What became of the experiment's claims."""
        return judge(self.experiment.claims, scores, self.detectors, self.white_box)
