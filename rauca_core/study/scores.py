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


@dataclass(frozen=True)
class Bootstrap:
    """Resamples behind every interval; the same ``seed`` draws the same ones."""

    resamples: int
    seed: int


def clusters_of(rows: Sequence[FrameRow]) -> Clusters:
    """What a resample draws: the frames' locations, or their views if there is one location."""
    return Clusters.of([row.location for row in rows], [row.view for row in rows])


def score_table(samples: Samples, rows: Sequence[FrameRow], bootstrap: Bootstrap) -> dict[str, dict[str, Estimate]]:
    """AP of every paint and detector, and the mean over detectors, each with its interval."""
    clusters = clusters_of(rows)
    counts = clusters.resample(bootstrap.resamples, bootstrap.seed)
    table = {}
    for paint, by_detector in samples.items():
        values = {name: average_precision(some) for name, some in by_detector.items()}
        resampled = {
            name: Ranking.of(some).average_precision(counts, clusters.of_frame) for name, some in by_detector.items()
        }
        values[MEAN] = float(np.mean(list(values.values())))
        resampled[MEAN] = np.mean(list(resampled.values()), axis=0)
        table[paint] = {name: Estimate(value, *interval(resampled[name])) for name, value in values.items()}
    return table


def score_groups(samples: Samples, rows: Sequence[FrameRow], bootstrap: Bootstrap) -> dict[str, tuple[Group, ...]]:
    """AP over the frames that share a value, for every axis and value."""
    rankings = {
        paint: {name: Ranking.of(some) for name, some in by_detector.items()} for paint, by_detector in samples.items()
    }
    return {axis: _along(axis, rankings, rows, bootstrap) for axis in AXES}


def _along(
    axis: str, rankings: Mapping[str, Mapping[str, Ranking]], rows: Sequence[FrameRow], bootstrap: Bootstrap
) -> tuple[Group, ...]:
    values = np.array([float(getattr(row, axis)) for row in rows])
    return tuple(
        _group(float(value), np.flatnonzero(values == value), rankings, rows, bootstrap) for value in np.unique(values)
    )


def _group(
    value: float,
    chosen: NDArray[np.int64],
    rankings: Mapping[str, Mapping[str, Ranking]],
    rows: Sequence[FrameRow],
    bootstrap: Bootstrap,
) -> Group:
    clusters = clusters_of([rows[index] for index in chosen])
    counts = clusters.resample(bootstrap.resamples, bootstrap.seed)
    counts = np.concatenate([np.ones_like(counts[:1]), counts])  # first the frames as they are, then the resamples
    ap, mean = {}, {}
    for paint, by_detector in rankings.items():
        curves = {
            name: ranking.part(chosen).average_precision(counts, clusters.of_frame)
            for name, ranking in by_detector.items()
        }
        over_detectors = np.mean(list(curves.values()), axis=0)
        ap[paint] = {name: float(curve[0]) for name, curve in curves.items()}
        mean[paint] = Estimate(float(over_detectors[0]), *interval(over_detectors[1:]))
    return Group(value, len(chosen), ap, mean)
