"""From detections to the numbers of a table: average precision with its interval, overall and along each parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .average_precision import Sample, average_precision
from .bootstrap import Clusters, Ranking, interval
from .results import AXES, MEAN, Estimate, FrameRow, Group

Samples = Mapping[str, Mapping[str, Sequence[Sample]]]  # [paint][detector][frame]
Curve = NDArray[np.float64]  # (1 + R,) AP@0.5 of the frames as they are, then of each resample


@dataclass(frozen=True)
class Bootstrap:
    """Resamples behind every interval; the same ``seed`` draws the same ones."""

    resamples: int
    seed: int


def clusters_of(rows: Sequence[FrameRow]) -> Clusters:
    """What a resample draws: the frames' locations, or their views if there is one location."""
    return Clusters.of([row.location for row in rows], [row.view for row in rows])


@dataclass(frozen=True, eq=False)
class Draws:
    """The frames as they are, then resamples of them, the same ones for every paint and detector.

    Attributes:
        counts: (1 + R, C) how often each cluster counts.
    """

    clusters: Clusters
    counts: NDArray[np.int64]

    @staticmethod
    def of(rows: Sequence[FrameRow], bootstrap: Bootstrap) -> Draws:
        clusters = clusters_of(rows)
        drawn = clusters.resample(bootstrap.resamples, bootstrap.seed)
        return Draws(clusters, np.concatenate([np.ones_like(drawn[:1]), drawn]))

    def curve(self, ranking: Ranking, ap: float | None = None) -> Curve:
        """AP of a ranking of the frames.

        Args:
            ap: of the frames as they are, where it is known.
        """
        values = ranking.average_precision(self.counts, self.clusters.of_frame)
        values[0] = values[0] if ap is None else ap
        return values


def estimate(curve: Curve) -> Estimate:
    """The value of a curve with its 95 % interval."""
    return Estimate(float(curve[0]), *interval(curve[1:]))


def score_table(samples: Samples, rows: Sequence[FrameRow], bootstrap: Bootstrap) -> dict[str, dict[str, Estimate]]:
    """AP of every paint and detector, and the mean over detectors, each with its interval."""
    draws, table = Draws.of(rows, bootstrap), {}
    for paint, by_detector in samples.items():
        curves = {n: draws.curve(Ranking.of(some), average_precision(some)) for n, some in by_detector.items()}
        curves[MEAN] = np.mean(list(curves.values()), axis=0)
        table[paint] = {name: estimate(curve) for name, curve in curves.items()}
    return table


def score_groups(samples: Samples, rows: Sequence[FrameRow], bootstrap: Bootstrap) -> dict[str, tuple[Group, ...]]:
    """AP over the frames that share a value, for every axis and value."""
    rankings = {
        paint: {name: Ranking.of(some) for name, some in by_detector.items()} for paint, by_detector in samples.items()
    }

    def group(value: float, chosen: NDArray[np.int64]) -> Group:
        draws, ap, mean = Draws.of([rows[index] for index in chosen], bootstrap), {}, {}
        for paint, by_detector in rankings.items():
            curves = {name: draws.curve(ranking.part(chosen)) for name, ranking in by_detector.items()}
            ap[paint] = {name: float(curve[0]) for name, curve in curves.items()}
            mean[paint] = estimate(np.mean(list(curves.values()), axis=0))
        return Group(value, len(chosen), ap, mean)

    values = {axis: np.array([float(getattr(row, axis)) for row in rows]) for axis in AXES}
    return {
        axis: tuple(group(float(value), np.flatnonzero(found == value)) for value in np.unique(found))
        for axis, found in values.items()
    }
