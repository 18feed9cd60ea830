"""Everything an ablation found, before anything decides how it looks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ..contestants import NORMAL, RANDOM
from ..families import is_own
from ..study import Study
from .experiment import Experiment, Variant
from .paired import Scores, score_rows
from .verdicts import Verdict, judge


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
