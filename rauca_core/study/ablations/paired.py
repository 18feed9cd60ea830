"""How far two variants are apart: the same resamples of the same places for both, so that a difference is paired.

A variant that was optimized with several seeds has as many camouflages; its AP is their mean, and every resample draws
seeds as well as places, so that an interval covers the luck of an optimization too. With one seed it does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...contract.seeding import named_rng
from ..bootstrap import Ranking, interval
from ..recorded import Recorded
from ..results import Estimate
from ..scores import clusters_of
from ..study import Entry

Curve = NDArray[np.float64]  # (1 + R,): AP of the frames as they are, then of every resample


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
        first = next(iter(self.curves.values()))
        return tuple(next(iter(first.values())))

    def ap(self, row: str, detectors: Sequence[str], weathers: Sequence[str]) -> Estimate:
        """AP of a row, averaged over detectors and sets of weathers."""
        return _estimate(self._mean(row, detectors, weathers))

    def difference(self, row: str, less: str, detectors: Sequence[str], weathers: Sequence[str]) -> Estimate:
        """AP of ``row`` minus that of ``less``, in the same places."""
        return _estimate(self._mean(row, detectors, weathers) - self._mean(less, detectors, weathers))

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
    return Scores({entry.weathers: _of_entry(entry, rows) for entry in entries})


def _of_entry(entry: Entry, rows: Mapping[str, Sequence[str]]) -> dict[str, dict[str, Curve]]:
    results, recorded = entry.results, Recorded(entry)
    clusters = clusters_of(results.frames)
    counts = clusters.resample(results.resamples, results.seed)
    counts = np.concatenate([np.ones_like(counts[:1]), counts])

    def curve(paint: str, detector: str) -> Curve:
        samples = [recorded.sample(detector, paint, index) for index in range(len(results.frames))]
        return Ranking.of(samples).average_precision(counts, clusters.of_frame)

    found = {}
    for row, paints in rows.items():
        share = _seed_shares(row, len(paints), results.resamples, results.seed)
        found[row] = {
            detector: np.asarray((share * np.stack([curve(paint, detector) for paint in paints], 1)).sum(1))
            for detector in results.detectors
        }
    return found


def _seed_shares(row: str, seeds: int, resamples: int, seed: int) -> NDArray[np.float64]:
    """(1 + R, S): how much each seed counts; equally at first, then as often as it is drawn, for each row by itself."""
    drawn = named_rng("seeds", row, seed).multinomial(seeds, np.full(seeds, 1 / seeds), size=resamples)
    return np.concatenate([np.ones((1, seeds)), drawn]) / seeds


def _estimate(curve: Curve) -> Estimate:
    return Estimate(float(curve[0]), *interval(curve[1:]))
