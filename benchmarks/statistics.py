"""How often intervals hold what they say, and how often chance is called a finding: simulated studies of known truth.

A study's truth is the mean of what all studies of its kind find. Detections are drawn to look like those of real ones:
the vehicle's score is a logistic function of a level, its place, its seed and its view; other detections come by a
place's rate and score lower. AP is computed by the project's own ranking. Beside every interval stands the one that
rauca had before, the percentiles of a bootstrap over places and seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rauca_core.contract.seeding import named_rng
from rauca_core.study.average_precision import Ranking
from rauca_core.study.intervals import (
    CONFIDENCE,
    SEEDS_NEEDED,
    Curve,
    Places,
    chance_of,
    difference_interval,
    holm,
    share_interval,
)

from .harness import Results, Settings, counted

FULL = Settings(studies=2000, old_studies=400, means=5000, resamples=500, places=(8, 16, 24), seeds=(2, 3, 5))
QUICK = FULL.but(studies=200, old_studies=50, means=1000, resamples=200)
WANTED = (0.94, 0.96)
VIEWS = 6  # of a place
# Logits of the vehicle's score where AP is about .05, .3, .6 and .95; spreads as between the views of real studies.
LEVELS = {"AP .05": -5.6, "AP .3": -3.2, "AP .6": -1.6, "AP .95": 1.7}
PLACE, SEED, VIEW = 0.8, 0.4, 2.0
WRONG = {"rate": 5.0, "spread": 0.5, "logit": -4.0, "width": 1.5}  # what is detected elsewhere in a frame
LEAST_SCORE = 0.005
FAMILY = 10  # claims of an ablation
MEAN_SPREADS = {"seeds": 0.05, "places": 0.1, "both": 0.05}  # of plain means: standard deviations
Interval = tuple[float, float]


def bench(out: Path, settings: Settings = FULL, docs: Path | None = None) -> Results:
    """Simulate everything and write what was found to ``out`` (JSON) and, where ``docs`` is a folder, to a page."""
    results = Results("statistics", settings)
    kinds = 1 + len(settings.seeds) + len(LEVELS) + 4
    with counted("statistics", kinds * len(settings.places) + len(settings.seeds)) as moved:
        for places in settings.places:
            for seeds in (1, *settings.seeds):
                _means(results, places, seeds)
                moved()
            for name, level in LEVELS.items():
                _covered(results, name, places, 1, level)
                moved()
            for name, level, other in (("AP .6 less .5", -1.6, -2.2), ("AP .95 less .9", 1.7, 0.8)):
                _covered(results, name, places, 1, level, other)
                moved()
            for name, less in (("AP .3", None), ("AP .3 less .3", LEVELS["AP .3"])):
                _covered(results, name, places, SEEDS_NEEDED, LEVELS["AP .3"], less)
                moved()
        for seeds in settings.seeds:
            _luck(results, seeds)
            moved()
    _tables(results)
    results.publish(out, docs, "statistics.md")
    return results


def percentiles(resampled: NDArray[np.float64]) -> Interval:
    """The interval that rauca had before."""
    low, high = np.quantile(resampled, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def without_each(table: NDArray[np.float64]) -> Curve:
    """(S, 1 + C) means of (S, C) values: of all places, then without each."""
    count = table.shape[1]
    return np.concatenate([table.mean(1, keepdims=True), (table.sum(1, keepdims=True) - table) / (count - 1)], 1)


def drawn_means(seeds: int, places: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """(S, C) normal figures about 0: what a place, a seed and both together make."""
    by = MEAN_SPREADS
    table = by["places"] * rng.normal(size=places) + by["both"] * rng.normal(size=(seeds, places))
    return table + by["seeds"] * rng.normal(size=(seeds, 1)) * (seeds > 1)


def drawn_ranking(level: float, hard: NDArray[np.float64], rng: np.random.Generator) -> Ranking:
    """What a detector finds in ``VIEWS`` views of each place; ``hard`` (C,) moves the logit of each place."""
    frames = len(hard) * VIEWS
    logits = level + np.repeat(hard, VIEWS) + VIEW * rng.normal(size=frames)
    rates = WRONG["rate"] * np.exp(WRONG["spread"] * rng.normal(size=len(hard)))
    wrong_in = np.repeat(np.arange(frames), rng.poisson(np.repeat(rates, VIEWS)))
    wrong = WRONG["logit"] + WRONG["width"] * rng.normal(size=len(wrong_in))
    scores = 1 / (1 + np.exp(-np.concatenate([logits, wrong])))
    frame, hit = np.concatenate([np.arange(frames), wrong_in]), np.arange(len(scores)) < frames
    order = np.argsort(-scores)
    order = order[scores[order] >= LEAST_SCORE]
    return Ranking(frame[order], hit[order], frames)


def _resampled(
    seeds: int, places: int, resamples: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """How often seeds (R, S; rows sum to 1) and places (R, C) count in each resample."""
    shares = rng.multinomial(seeds, np.full(seeds, 1 / seeds), size=resamples) / seeds
    return shares, rng.multinomial(places, np.full(places, 1 / places), size=resamples)


def _means(results: Results, places: int, seeds: int) -> None:
    """Coverage of the mean of normal draws."""
    settings = results.settings
    rng = named_rng("statistics", "means", places, seeds)
    shares, counts = _resampled(seeds, places, settings.resamples, rng)
    new, old = [], []
    for number in range(settings.means):
        table = drawn_means(seeds, places, rng)
        new.append(difference_interval(without_each(table), places * VIEWS))
        if number < settings.old_studies:
            old.append(percentiles(((shares @ table) * counts).sum(1) / places))
    _count(results, "normal draws", places, seeds, 0.0, new, old)


def _covered(results: Results, name: str, places: int, seeds: int, level: float, less: float | None = None) -> None:
    """Coverage of AP at a level, or of its difference from another one in the same places."""
    settings, values, new, old = results.settings, [], [], []
    rng = named_rng("statistics", name, places, seeds)
    where = Places("locations", np.repeat(np.arange(places), VIEWS), places)
    shares, counts = _resampled(seeds, places, settings.resamples, rng)
    for number in range(settings.studies):
        hard = PLACE * rng.normal(size=places)
        luck = SEED * rng.normal(size=(2, seeds)) if seeds > 1 else np.zeros((2, 1))
        arms = [level] if less is None else [level, less]
        rankings = [
            [drawn_ranking(one + luck[arm, seed], hard, rng) for seed in range(seeds)] for arm, one in enumerate(arms)
        ]
        curve = _less(rankings, lambda one: one.average_precision(where.left_out(), where.of_frame))
        values.append(float(curve[:, 0].mean()))
        kind = share_interval if less is None else difference_interval
        new.append(kind(curve, places * VIEWS))
        if number < settings.old_studies:
            bootstrap = _less(rankings, lambda one: one.average_precision(counts, where.of_frame))
            old.append(percentiles((shares.T * bootstrap).sum(0)))
    _count(results, name, places, seeds, float(np.mean(values)), new, old)


def _less(rankings: list[list[Ranking]], ap: Callable[[Ranking], NDArray[np.float64]]) -> NDArray[np.float64]:
    """(S, N) the first arm's AP, less the second's where there is one."""
    one, *other = (np.stack([ap(ranking) for ranking in arm]) for arm in rankings)
    return one - other[0] if other else one


def _count(
    results: Results, what: str, places: int, seeds: int, truth: float, new: list[Interval], old: list[Interval]
) -> None:
    kept = {}
    for name, intervals in (("new", new), ("old", old)):
        low, high = np.array(intervals).T
        kept[name] = float(((low <= truth) & (truth <= high)).mean())
        kept[f"{name}_width"] = float((high - low).mean())
    results.add("coverage", what=what, places=places, seeds=seeds, truth=truth, **kept)


def _luck(results: Results, seeds: int) -> None:
    """Ablations of arms that differ in the luck of their seeds alone: how often is one said to be better?"""
    settings, places = results.settings, results.settings.places[0]
    rng = named_rng("statistics", "luck", seeds)
    shares, counts = _resampled(seeds, places, settings.resamples, rng)
    other_shares, _ = _resampled(seeds, places, settings.resamples, rng)
    old = []
    for _ in range(settings.old_studies):
        one, other = drawn_arms(seeds, places, rng, 2)
        low, high = percentiles((((shares @ one) - (other_shares @ other)) * counts).sum(1) / places)
        old.append(low > 0 or high < 0)
    chances = np.array([_family(seeds, places, rng) for _ in range(settings.studies)])
    corrected = np.array([holm(family) for family in chances.tolist()])
    called = 1.0 if seeds >= SEEDS_NEEDED else 0.0
    alpha = 1 - CONFIDENCE
    results.add(
        "luck", seeds=seeds, old=float(np.mean(old)), test=float((chances[:, 0] <= alpha).mean()),
        verdict=called * float((corrected[:, 0] <= alpha).mean()),
        family_uncorrected=float((chances <= alpha).any(1).mean()),
        family=called * float((corrected <= alpha).any(1).mean()),
    )  # fmt: skip


def drawn_arms(seeds: int, places: int, rng: np.random.Generator, count: int) -> Iterator[NDArray[np.float64]]:
    """(S, C) figures of arms that are equally good, in the same places."""
    hard = MEAN_SPREADS["places"] * rng.normal(size=places)
    for _ in range(count):
        own = MEAN_SPREADS["seeds"] * rng.normal(size=(seeds, 1))
        yield hard + own + MEAN_SPREADS["both"] * rng.normal(size=(seeds, places))


def _family(seeds: int, places: int, rng: np.random.Generator) -> list[float]:
    """Chances of the claims that each of ten arms beats the plain one."""
    first, *others = (without_each(arm) for arm in drawn_arms(seeds, places, rng, FAMILY + 1))
    return [chance_of(one - first, places * VIEWS) for one in others]


def _tables(results: Results) -> None:
    columns = {
        "figure": "{what}", "places": "{places}", "seeds": "{seeds}", "mean": "{truth:.3f}", "covered": "{new:.3f}",
        "by the old interval": "{old:.3f}", "mean width": "{new_width:.3f}", "old width": "{old_width:.3f}",
    }  # fmt: skip
    results.table("How often a 95 % interval holds the truth", columns, results.rows["coverage"])
    told = {
        "seeds": "{seeds}", "one claim, old rule": "{old:.3f}", "one claim, t-test": "{test:.3f}",
        "one claim, verdict": "{verdict:.3f}", f"any of {FAMILY}, uncorrected": "{family_uncorrected:.3f}",
        f"any of {FAMILY}, verdict": "{family:.3f}",
    }  # fmt: skip
    results.table("How often equal arms are called different", told, results.rows["luck"])
    for row in results.rows["coverage"]:
        if row["seeds"] in (1, SEEDS_NEEDED):
            what = f"{row['what']}, {row['places']} places, {row['seeds']} seeds"
            results.target(f"{what}: at least", WANTED[0], row["new"])
            results.target(f"{what}: at most", WANTED[1], row["new"], most=True)
    for row in results.rows["luck"]:
        results.target(f"{row['seeds']} seeds: false verdict in a family", 0.06, row["family"], most=True)
