"""Ablations: declarations that hold together, gaps of pairs against their definition, verdicts, and the page."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.stability.detectors import SmallDetector
from rauca_core.attack import METHODS, make_settings, settings_of
from rauca_core.detect import Detector
from rauca_core.report import write_ablation
from rauca_core.report.published import paper_tables
from rauca_core.study.ablate import TRAINING_SETS, Ablation, chosen_frames, training_plan
from rauca_core.study.ablations.catalogue import EXPERIMENTS, experiment_named
from rauca_core.study.ablations.experiment import QUICK, Claim, Sizes
from rauca_core.study.ablations.findings import Comparison, Findings, Scores, Verdict, judge, score_rows
from rauca_core.study.average_precision import Sample
from rauca_core.study.candidates import find_vehicles, keep_copy
from rauca_core.study.results import Estimate
from rauca_core.study.study import Entry, Study, save_study
from tests.study.measured import FRAMES, found_in, measure, scored
from tests.study.page import whole_page, written_elsewhere

DEFAULT = Sizes()
# The ablation of the study in this folder, by a process of its own.
WRITE_AGAIN = """
from pathlib import Path
from rauca_core.study.ablations.catalogue import (experiment_named)
from rauca_core.study.ablations.findings import (Findings)
from rauca_core.report import (write_ablation)
from rauca_core.study.study import load_study

study, experiment = load_study(Path(".")), experiment_named("augmentation")
runs = {name: [name] for name in study.entries[0].results.paints}
found = Findings(experiment, (experiment.variant("with-roa"),), study, runs, ("yolov4-tiny",))
write_ablation(found, Path("ablation.html"))
"""


@pytest.fixture
def asked() -> Ablation:
    beta = experiment_named("beta")
    return Ablation(beta, beta.variants, 1, DEFAULT, find_vehicles(["sedan"])[0])


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_experiments_hold_together(asked: Ablation, name: str) -> None:
    """Every variant is an optimization of its own; claims are about variants; rows beside the paper's are its rows."""
    experiment = experiment_named(name)
    keys = [variant.key for variant in experiment.variants]
    assert len(set(keys)) == len(keys)
    assert {key for claim in experiment.claims for key in (*claim.better, *claim.worse)} <= {*keys, "normal", "random"}
    printed = {paper.beside: {row.name for row in paper.table.blocks[0].rows} for paper in paper_tables()}
    if experiment.paper:
        assert {variant.paper_row for variant in experiment.variants} - {None} <= printed[experiment.paper]
        assert any(variant.paper_row for variant in experiment.variants)
    own = [asked.own_settings(variant) for variant in experiment.variants]
    assert all(own[i] != own[j] for i in range(len(own)) for j in range(i))
    assert sum(variant.quick for variant in experiment.variants) >= 2
    assert experiment.seeds * len(experiment.variants) <= 9  # what fits two hours
    for variant in experiment.variants:
        settings = asked.settings(variant, 3, "label")
        assert (settings.seed, settings.name, settings.steps) == (3, "label", DEFAULT.steps)
        assert variant.training in TRAINING_SETS


@pytest.mark.parametrize("method", METHODS)
def test_a_row_named_after_a_method_is_that_method(asked: Ablation, method: str) -> None:
    """But for the ablation's size, what is optimized is what `rauca optimize --method` optimizes."""
    variant = experiment_named("baselines").variant(method)
    same = {"steps": DEFAULT.steps, "batch": DEFAULT.batch, "map_size": DEFAULT.map_size}
    assert asked.settings(variant).identity() == make_settings(**settings_of(method, **same)).identity()


def test_a_camouflage_is_kept_by_how_long_its_extractor_was_trained(asked: Ablation) -> None:
    digests = []
    for light in ("published", "exact"):
        variant = next(v for v in experiment_named("environment").variants if v.settings.get("light", "exact") == light)
        for epochs in (DEFAULT.extractor_epochs, QUICK.extractor_epochs):
            sizes = replace(DEFAULT, extractor_epochs=epochs)
            digests.append(replace(asked, sizes=sizes).paint(variant, 0, "x", [("small", SmallDetector())]).digest)
    assert [len(set(digests[:2])), len(set(digests[2:]))] == [2, 1]


def test_what_two_ablations_call_otherwise_is_one(asked: Ablation) -> None:
    white_box = [("small", SmallDetector())]
    one, two = experiment_named("augmentation").variant("with-roa"), experiment_named("renderer").variant("e2e-taps")
    assert asked.paint(one, 0, "a", white_box).digest == asked.paint(two, 0, "b", white_box).digest
    assert asked.paint(one, 1, "a", white_box).digest != asked.paint(two, 0, "b", white_box).digest


def test_training_sets_are_balanced_and_smaller_ones_are_part_of_larger_ones() -> None:
    sedan = find_vehicles(["sedan"])[0]
    for name in TRAINING_SETS:
        plan = training_plan(name, sedan, DEFAULT)
        every, part = chosen_frames(plan, DEFAULT), chosen_frames(plan, DEFAULT, 1 / 16)
        assert len(every) == DEFAULT.frames
        assert len(part) == DEFAULT.frames // 16
        assert set(part) < set(every)
        for place, least in ((0, 96 // 8), (2, 96 // len(plan.weathers))):
            counts = np.unique([frame.split("-", 2)[place] for frame in every], return_counts=True)[1]
            assert counts.min() >= least - 1
    assert QUICK.frames < DEFAULT.frames


def entry_of(monkeypatch: pytest.MonkeyPatch, samples: dict[str, dict[str, list[Sample]]], weathers: str) -> Entry:
    """Results over eight locations, computed by the evaluation's own scores."""
    entry = Entry(weathers, "none", "sedan", "car", scored(samples), Path(weathers))
    monkeypatch.setattr("rauca_core.study.recorded.Recorded.sample", lambda _, d, p, i: samples[p][d][i])
    return entry


@pytest.fixture
def scores(monkeypatch: pytest.MonkeyPatch) -> tuple[Scores, Entry]:
    """Paints found everywhere, in six places of eight, in the same less a frame, and nowhere; one of two seeds."""
    most = ~np.isin(np.arange(FRAMES) % 8, (0, 3))
    less = most.copy()
    less[1] = False
    paints = {"all": np.ones(FRAMES, bool), "most": most, "less": less, "none": np.zeros(FRAMES, bool)}
    samples = {name: {"d1": found_in(hit), "d2": found_in(~hit | hit)} for name, hit in paints.items()}
    entry = entry_of(monkeypatch, samples, "seen")
    rows = {"all": ["all"], "most": ["most"], "less": ["less"], "none": ["none"], "both": ["all", "none"]}
    return score_rows([entry, replace(entry, weathers="unseen")], rows), entry


def test_a_rows_interval_is_that_of_the_results(scores: tuple[Scores, Entry]) -> None:
    found, entry = scores
    for row in ("all", "most", "none"):
        for detector in ("d1", "d2"):
            assert found.ap(row, [detector], ["seen"]) == entry.results.table[row][detector]


def test_gaps_are_paired(scores: tuple[Scores, Entry]) -> None:
    """One frame apart, in the same places: far surer than from two intervals by themselves."""
    found, _ = scores
    gap, one = found.difference("most", "less", ["d1"], ["seen"]), found.ap("most", ["d1"], ["seen"])
    assert gap.ap == pytest.approx(one.ap - found.ap("less", ["d1"], ["seen"]).ap)
    assert one.high - one.low > 0.2
    assert gap.high - gap.low < 0.6 * (one.high - one.low)
    twice = found.difference("all", "none", ["d1"], ["seen", "unseen"])
    assert twice.ap == found.difference("all", "none", ["d1"], ["seen"]).ap == 1


def test_seeds_are_averaged_and_held_against_the_same_seeds(scores: tuple[Scores, Entry]) -> None:
    found, _ = scores
    both = found.ap("both", ["d1"], ["seen"])
    assert both.ap == pytest.approx(found.ap("all", ["d1"], ["seen"]).ap / 2)
    assert (both.low, both.high) == pytest.approx((0, 1), abs=0.01)  # the luck of one optimization of two
    assert (found.seeds("both"), found.seeds("both", "all"), found.seeds("normal")) == (2, 1, 5)
    same = found.difference("both", "both", ["d1"], ["seen"])
    assert same.ap == 0
    assert same.high < 0.2


@pytest.fixture
def five(monkeypatch: pytest.MonkeyPatch) -> Scores:
    """Rows of five seeds: one found everywhere, one in half of the places or one more, and one that nobody finds."""
    half = np.arange(FRAMES) % 8 < 4
    rows: dict[str, list[str]] = {"all": [], "half": [], "none": []}
    samples: dict[str, dict[str, list[Sample]]] = {}
    for seed in range(5):
        more = half | (np.arange(FRAMES) == 4 + seed)
        for row, hit in (("all", half | ~half), ("half", more), ("none", half & ~half)):
            samples[f"{row} {seed}"] = {"d1": found_in(hit), "d2": found_in(hit)}
            rows[row].append(f"{row} {seed}")
    return score_rows([entry_of(monkeypatch, samples, "seen")], rows)


def test_verdicts_follow_the_corrected_chance_of_the_gap(five: Scores) -> None:
    claims = [
        Claim(("none",), ("all",)),
        Claim(("all",), ("none",)),
        Claim(("none",), ("none",)),
        Claim(("none", "all"), ("all", "none")),
        Claim(("gone",), ("all",)),
        Claim(("gone", "none"), ("all",)),
    ]
    verdicts = judge(claims, five, ["d1"], ["d2"])
    assert [v.outcome for v in verdicts] == ["confirmed", "refuted", "undecided", "refuted", "confirmed"]
    sentence = verdicts[0].sentence({"none": "None", "all": "All"})
    assert sentence.startswith("None below All: confirmed; AP apart by +1.000 [+0.9")
    assert sentence.endswith("+1.000] (the paper's claim)")
    (comparison,) = verdicts[0].comparisons
    assert set(comparison.by_scope) == {"white box"}
    alone = judge(claims[:1], five, ["d1"], [])[0].comparisons[0]
    assert comparison.chance == pytest.approx(7 * alone.chance, rel=0.2)  # of eight pairs, equal ones count too
    narrow = Comparison("none", "mean", Estimate(-0.05, -0.06, -0.04), {}, 5, 0.01)
    wide = Comparison("all", "mean", Estimate(0.02, -0.2, 0.1), {}, 5, 0.6)  # undecided: not what refutes the claim
    refuted = Verdict(Claim(("none", "all"), ("mean",)), (narrow, wide))
    assert "refuted; AP, least of None to Mean, apart by -0.050" in refuted.sentence(
        {"none": "None", "all": "All", "mean": "Mean"}
    )


def test_a_gap_that_one_claim_may_show_is_chance_among_many() -> None:
    gap = Estimate(0.05, 0.01, 0.09)
    assert [Comparison("a", "b", gap, {}, 5, chance).outcome for chance in (0.04, 0.06)] == ["confirmed", "undecided"]


def test_nothing_is_called_with_fewer_than_five_seeds(scores: tuple[Scores, Entry]) -> None:
    found, _ = scores
    (one,) = judge([Claim(("none",), ("all",))], found, ["d1"], [])
    assert one.comparisons[0].chance < 1e-6
    assert one.outcome == "undecided"
    assert "None below All: undecided: 1 seed, 5 are needed; AP apart by +1.000" in one.sentence(
        {"none": "None", "all": "All"}
    )


def test_the_page_holds_the_table_the_papers_and_every_picture(
    scene, detectors: list[Detector], tmp_path: Path
) -> None:  # type: ignore[no-untyped-def]
    views, out = scene.dataset, tmp_path / "out"
    paints = {"normal": views.folder, "random": scene.noise, "with-roa": scene.noise}
    results = measure(views, paints, detectors, out / "seen")
    named = {n: keep_copy(n, scene.camouflage, out) for n in ("random", "with-roa")}
    entry = Entry("seen", "none", "box", "car", results, out / "seen", views.folder, named)
    experiment = experiment_named("augmentation")
    found = Findings(
        experiment,
        (experiment.variant("with-roa"),),
        Study("rauca ablate <augmentation>", (entry,)),
        {name: [name] for name in paints},
        ("yolov4-tiny",),
    )
    page, lines, numbers, latex = write_ablation(found, out / "ablation.html")
    read = whole_page(page)
    assert len(read.loads) == 3 * 5 + 2  # five frames in three paints, two UV maps
    for text in ("With ROA", "Table 12: published figures", "0.082", "rauca ablate <augmentation>"):
        assert text in read.text
    stored = json.loads(numbers.read_text(encoding="utf-8"))
    assert stored["verdicts"] == []  # one of its rows is not here
    rows = list(csv.DictReader(lines.read_text(encoding="utf-8").splitlines()))
    means = {
        (row["column"], row["row"]): float(row["value"])
        for row in rows
        if row["table"] == "ablation-augmentation" and row["group"] == "Average"
    }
    assert means == {  # never averaged together
        (part, title): pytest.approx(results.table[paint][name].ap)
        for part, name in (("family of an attacked one", "yolov2-tiny"), ("attacked", "yolov4-tiny"))
        for title, paint in zip(("Normal", "Random", "With ROA"), paints, strict=True)
    }
    assert found.detectors == ["yolov2-tiny"]  # it decides

    save_study(out / "study.json", found.study.command, [entry])
    written_elsewhere(tmp_path, WRITE_AGAIN, [page, lines, numbers, latex])
