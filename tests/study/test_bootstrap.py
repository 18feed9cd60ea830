"""Intervals by a bootstrap over locations, and the arithmetic that makes all resamples at once."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.study.average_precision import Sample, average_precision
from rauca_core.study.bootstrap import Clusters, Ranking, interval

TRUTH = np.array([10.0, 10.0, 50.0, 50.0])


def found(score: float = 0.9) -> Sample:
    return Sample(TRUTH, TRUTH[None], np.array([score]))


def nothing() -> Sample:
    return Sample(TRUTH, np.zeros((0, 4)), np.zeros(0))


def random_samples(count: int, seed: int) -> list[Sample]:
    """Scores without ties, so that copies of a frame in a resample are the only ones."""
    rng = np.random.default_rng(seed)
    samples = []
    for _ in range(count):
        boxes = TRUTH + rng.normal(0, rng.choice([3, 12, 60]), (rng.integers(0, 7), 4))
        boxes[:, 2:] = np.maximum(boxes[:, 2:], boxes[:, :2] + 1)
        samples.append(Sample(TRUTH, boxes, rng.random(len(boxes))))
    return samples


@pytest.mark.parametrize("seed", range(6))
def test_every_resample_is_the_average_precision_of_its_frames(seed: int) -> None:
    samples = random_samples(40, seed)
    locations = np.random.default_rng(seed).integers(0, 7, 40)
    clusters = Clusters.of(locations.tolist(), list(range(40)))
    counts = clusters.resample(20, seed)
    assert clusters.kind == "locations"
    assert (counts.sum(1) == clusters.count).all()
    values = Ranking.of(samples).average_precision(counts, clusters.of_frame)
    for count, value in zip(counts, values, strict=True):
        drawn = [one for one, times in zip(samples, count[clusters.of_frame], strict=True) for _ in range(times)]
        assert value == pytest.approx(average_precision(drawn), abs=1e-9)
    assert len(set(values.round(6))) > 10


@pytest.mark.parametrize("seed", range(4))
def test_a_part_of_a_ranking_is_the_ranking_of_the_part(seed: int) -> None:
    samples = random_samples(30, seed)
    chosen = np.flatnonzero(np.random.default_rng(seed).random(30) < 0.4)
    once, together = np.ones((1, 1), np.int64), np.zeros(len(chosen), np.int64)
    (value,) = Ranking.of(samples).part(chosen).average_precision(once, together)
    assert value == pytest.approx(average_precision([samples[index] for index in chosen]), abs=1e-9)


def test_clusters_are_as_coarse_as_the_data_set_allows() -> None:
    assert Clusters.of([3, 3, 5, 5], [0, 1, 0, 1]).of_frame.tolist() == [0, 0, 1, 1]
    one_location = Clusters.of([3, 3, 3, 3], [7, 2, 7, 2])
    assert (one_location.kind, one_location.of_frame.tolist()) == ("views", [1, 0, 1, 0])
    assert (Clusters.of([3, 3], [7, 7]).kind, Clusters.of([3, 3], [7, 7]).count) == ("frames", 2)


def test_frames_of_one_location_do_not_count_as_independent() -> None:
    """Ten locations whose frames agree: 100 frames are worth ten, and the interval is as wide as of ten frames."""
    locations = [index // 10 for index in range(100)]
    samples = [found() if location < 5 else nothing() for location in locations]
    by_location = Clusters.of(locations, locations)
    by_frame = Clusters("frames", np.arange(100))
    wide, narrow = (
        np.ptp(interval(Ranking.of(samples).average_precision(clusters.resample(1000, 0), clusters.of_frame)))
        for clusters in (by_location, by_frame)
    )
    assert wide == pytest.approx(narrow * np.sqrt(10), rel=0.15)


def test_the_interval_covers_the_truth_as_often_as_it_says() -> None:
    """Frames found with chance 0.6 and nothing else detected: AP is the share found, so its spread is binomial."""
    rng = np.random.default_rng(5)
    covered = 0
    for trial in range(100):
        samples = [found() if rng.random() < 0.6 else nothing() for _ in range(80)]
        clusters = Clusters("frames", np.arange(80))
        low, high = interval(Ranking.of(samples).average_precision(clusters.resample(200, trial), clusters.of_frame))
        covered += low <= 0.6 + 0.5 / 101 <= high
    assert 86 <= covered <= 100


def test_the_same_seed_draws_the_same_resamples_and_nothing_found_has_no_spread() -> None:
    clusters = Clusters("frames", np.arange(3))
    assert (clusters.resample(10, 4) == clusters.resample(10, 4)).all()
    assert (clusters.resample(10, 4) != clusters.resample(10, 5)).any()
    counts = clusters.resample(10, 0)
    assert interval(Ranking.of([nothing()] * 3).average_precision(counts, clusters.of_frame)) == (0.0, 0.0)
