"""Intervals over places and seeds: against scipy, exact small cases, coverage of a seeded simulation, Holm."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rauca_core.study.average_precision import Ranking, Sample, average_precision
from rauca_core.study.intervals import Places, chance_of, difference_interval, holm, share_interval, spread
from rauca_core.study.scores import ap_curve

TRUTH = np.array([10.0, 10.0, 50.0, 50.0])


def found(score: float = 0.9) -> Sample:
    return Sample(TRUTH, TRUTH[None], np.array([score]))


def nothing() -> Sample:
    return Sample(TRUTH, np.zeros((0, 4)), np.zeros(0))


def random_samples(count: int, seed: int) -> list[Sample]:
    """Scores without ties, so that copies of a frame are the only ones."""
    rng = np.random.default_rng(seed)
    samples = []
    for _ in range(count):
        boxes = TRUTH + rng.normal(0, rng.choice([3, 12, 60]), (rng.integers(0, 7), 4))
        boxes[:, 2:] = np.maximum(boxes[:, 2:], boxes[:, :2] + 1)
        samples.append(Sample(TRUTH, boxes, rng.random(len(boxes))))
    return samples


def mean_curve(values: np.ndarray) -> np.ndarray:
    """Means (..., 1 + C) of values (..., C), one a place: of all, then without each."""
    count = values.shape[-1]
    without = (values.sum(-1, keepdims=True) - values) / (count - 1)
    return np.concatenate([values.mean(-1, keepdims=True), without], -1)


@pytest.mark.parametrize("seed", range(6))
def test_frames_may_count_as_often_as_one_likes(seed: int) -> None:
    samples = random_samples(40, seed)
    places = Places.of(np.random.default_rng(seed).integers(0, 7, 40).tolist(), list(range(40)))
    counts = np.concatenate([places.left_out(), np.random.default_rng(seed).integers(1, 4, (8, places.count))])
    values = Ranking.of(samples).average_precision(counts, places.of_frame)
    for count, value in zip(counts, values, strict=True):
        drawn = [one for one, times in zip(samples, count[places.of_frame], strict=True) for _ in range(times)]
        assert value == pytest.approx(average_precision(drawn), abs=1e-9)
    assert len(set(values.round(6))) > 10


@pytest.mark.parametrize("seed", range(4))
def test_a_part_of_a_ranking_is_the_ranking_of_the_part(seed: int) -> None:
    samples = random_samples(30, seed)
    chosen = np.flatnonzero(np.random.default_rng(seed).random(30) < 0.4)
    once, together = np.ones((1, 1), np.int64), np.zeros(len(chosen), np.int64)
    (value,) = Ranking.of(samples).part(chosen).average_precision(once, together)
    assert value == pytest.approx(average_precision([samples[index] for index in chosen]), abs=1e-9)


def test_a_ranking_that_leaves_out_all_of_its_frames_finds_nothing() -> None:
    counts = np.array([[1, 1], [0, 1]])
    assert Ranking.of([found(), found()]).average_precision(counts, np.zeros(2, np.int64)).tolist() == [1, 0]


def test_places_are_as_coarse_as_the_data_set_allows() -> None:
    assert Places.of([3, 3, 5, 5], [0, 1, 0, 1]).of_frame.tolist() == [0, 0, 1, 1]
    one_location = Places.of([3, 3, 3, 3], [7, 2, 7, 2])
    assert (one_location.kind, one_location.of_frame.tolist()) == ("views", [1, 0, 1, 0])
    assert (Places.of([3, 3], [7, 7]).kind, Places.of([3, 3], [7, 7]).count) == ("frames", 2)


@pytest.mark.parametrize("count", [2, 3, 8, 24])
def test_of_a_plain_mean_it_is_students_interval(count: int) -> None:
    values = np.random.default_rng(count).normal(0.1, 0.02, count)
    test = stats.ttest_1samp(values, 0)
    expected = test.confidence_interval(0.95)
    ends = (-np.inf, np.inf)
    assert difference_interval(mean_curve(values), 10**9, ends) == pytest.approx((expected.low, expected.high))
    assert chance_of(mean_curve(values), 10**9) == pytest.approx(test.pvalue)


def test_a_paired_difference_is_scipys_paired_test() -> None:
    rng = np.random.default_rng(1)
    places = rng.normal(0.4, 0.2, 12)
    one, other = places + rng.normal(0, 0.03, 12), places + rng.normal(0.05, 0.03, 12)
    paired = stats.ttest_rel(other, one)
    curve = mean_curve(other) - mean_curve(one)
    assert chance_of(curve, 10**9) == pytest.approx(paired.pvalue)
    assert difference_interval(curve, 10**9) == pytest.approx(tuple(paired.confidence_interval(0.95)))


def test_where_places_agree_only_seeds_count() -> None:
    """Then the interval is Student's over the seeds' figures, and the other way round."""
    values = np.random.default_rng(2).normal(0.1, 0.02, 5)
    alike = mean_curve(np.repeat(values[:, None], 9, 1))
    expected = tuple(stats.ttest_1samp(values, 0).confidence_interval(0.95))
    assert difference_interval(alike, 10**9) == pytest.approx(expected)
    assert difference_interval(mean_curve(np.repeat(values[None], 6, 0)), 10**9) == pytest.approx(expected)


def test_the_error_of_seeds_and_places_is_that_of_the_crossed_layout() -> None:
    """A layout of 3 seeds and 4 places, by its mean squares as textbooks compute them."""
    table = np.array([[1.0, 2, 3, 6], [2, 2, 5, 7], [0, 3, 1, 4]]) / 10
    rows, columns, mean = table.mean(1), table.mean(0), table.mean()
    by_seed = 4 * ((rows - mean) ** 2).sum() / 2
    by_place = 3 * ((columns - mean) ** 2).sum() / 3
    rest = ((table - rows[:, None] - columns + mean) ** 2).sum() / 6
    known = spread(mean_curve(table))
    assert known.error**2 == pytest.approx((by_seed + by_place - rest) / 12)
    wanted = (by_seed + by_place - rest) ** 2 / (by_seed**2 / 2 + (by_place - rest) ** 2 / 3)
    assert known.freedom == pytest.approx(min(wanted, 5))


@pytest.mark.parametrize("samples", [[found()] * 48, [nothing()] * 48])
def test_always_or_never_found_leaves_a_doubt(samples: list[Sample]) -> None:
    places = Places.of([index // 6 for index in range(48)], list(range(48)))
    curve = ap_curve(Ranking.of(samples), places)
    low, high = share_interval(curve, 48)
    assert 0 <= low <= curve[0] <= high <= 1
    assert 0.02 < high - low < 0.2
    low, high = difference_interval(curve - curve, 48)
    assert -0.1 < low < 0 < high < 0.1
    assert share_interval(np.stack([curve] * 5), 48)[1] <= 1


@pytest.mark.parametrize("seeds", [1, 3])
def test_one_place_alone_says_nothing_of_others(seeds: int) -> None:
    curve = np.full((seeds, 2), 0.7)
    assert share_interval(curve, 1) == (0, 1)
    assert difference_interval(curve, 1) == (-1, 1)
    assert chance_of(curve, 1) == 1
    places = Places.of([4], [2])
    assert share_interval(ap_curve(Ranking.of([found()]), places), 1) == (0, 1)


def test_frames_of_one_location_do_not_count_as_independent() -> None:
    """Ten locations whose frames agree: 100 frames are worth ten, and the interval is as wide as of ten frames."""
    locations = [index // 10 for index in range(100)]
    ranking = Ranking.of([found() if location < 5 else nothing() for location in locations])
    wide = spread(ap_curve(ranking, Places.of(locations, locations))).error
    narrow = spread(ap_curve(ranking, Places("frames", np.arange(100), 100))).error
    assert wide == pytest.approx(narrow * np.sqrt(11), rel=0.01)


def test_the_interval_covers_the_truth_as_often_as_it_says() -> None:
    """Eight places of six frames, each found with its place's own chance: shares of .4, .8 and .95 on average."""
    rng, places = np.random.default_rng(5), Places.of(np.repeat(np.arange(8), 6).tolist(), list(range(48)))
    counts = places.left_out()[:, places.of_frame].astype(float)
    for level in (0.4, 0.8, 0.95):
        chances = rng.beta(8 * level, 8 * (1 - level), (600, 8))
        hits = rng.random((600, 48)) < chances[:, places.of_frame]
        intervals = [share_interval(counts @ one / counts.sum(1), 48) for one in hits]
        assert 0.925 <= np.mean([low <= level <= high for low, high in intervals]) <= 0.985


def test_seed_luck_is_no_finding() -> None:
    """Two arms of five seeds that differ in nothing but their seeds, in the same eight places."""
    rng, false = np.random.default_rng(6), 0
    for _ in range(600):
        arms = 0.4 + 0.1 * rng.normal(size=8) + 0.05 * rng.normal(size=(2, 5, 1)) + 0.05 * rng.normal(size=(2, 5, 8))
        one, other = mean_curve(arms)
        false += chance_of(one - other, 10**6) <= 0.05
    assert 0.02 <= false / 600 <= 0.08


def test_many_claims_are_corrected_as_by_holm() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.5, 0.9]) == [1.0, 1.0]
    assert holm([0.2]) == [0.2]
    assert holm([]) == []
