"""Finished studies held together: rows of seeds, judges by their part in the attack, the order that others found."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from torch import Tensor
from typer.testing import CliRunner

from pipelines.cli import app
from rauca_core.contract import Camouflage, RaucaError, save_camouflage
from rauca_core.contract.files import png_bytes
from rauca_core.contract.towns import TEST
from rauca_core.detect import Detector, load_detector
from rauca_core.report import write_compared
from rauca_core.report.published import published_means
from rauca_core.study.compare import Compared, compare, rows_of
from rauca_core.study.study import Entry, Study, save_study
from tests.study.measured import FRAMES, PLACES, found_in, measure, scored
from tests.study.page import whole_page


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Compared:
    """Five seeds of each method but one, found in more and more places, by what they attacked and by two judges."""
    places = np.arange(FRAMES) % PLACES
    shown = {"normal": 8, "das": 7, "fca": 5, "dta": 3, "ours": 1, "theirs": 2}
    samples, rows = {}, {}
    for row, count in shown.items():
        rows[row] = [row] if row in ("normal", "theirs") else [f"{row} s{seed}" for seed in range(5)]
        for seed, paint in enumerate(rows[row]):
            hit = (places < count) & (np.arange(FRAMES) != 3 * seed)
            by = {"yolov3-tiny": hit & (row == "normal"), "yolov2-tiny": hit, "yolov8s": hit, "frcnn-synth": ~hit | hit}
            samples[paint] = {name: found_in(one) for name, one in by.items()}
    results = scored(samples)
    monkeypatch.setattr("rauca_core.study.recorded.Recorded.sample", lambda _, d, p, i: samples[p][d][i])
    attacked = {row: frozenset({"yolov3-tiny"} if row not in ("normal", "theirs") else ()) for row in rows}
    return Compared((Entry("seen", "none", "sedan", "car", results, Path("seen")),), rows, attacked, 20_000)


def test_seeds_of_a_name_are_a_row() -> None:
    assert rows_of(["normal", "a s0", "b", "a s10", "as1"]) == {
        "normal": ["normal"], "a": ["a s0", "a s10"], "b": ["b"], "as1": ["as1"],
    }  # fmt: skip


def test_detectors_stand_by_their_part_in_the_attack(drawn: Compared) -> None:
    assert (drawn.judges, drawn.relatives) == (["yolov8s"], ["yolov2-tiny"])  # this project's own one is neither
    assert drawn.white_box("ours") == drawn.white_box("theirs") == ["yolov3-tiny"]
    assert (drawn.use, drawn.places) == ("test", "8 locations")
    assert replace(drawn, town=TEST["demo"] + 1_000_000).use == "unlisted"
    table = drawn.entries[0].results.table
    of_seeds = [table[paint]["yolov8s"].ap for paint in drawn.rows["ours"]]
    assert len(set(of_seeds)) > 1
    assert drawn.ap("ours", drawn.judges).ap == pytest.approx(np.mean(of_seeds))
    assert drawn.ap("normal", drawn.judges) == table["normal"]["yolov8s"]


def test_a_row_is_below_others_where_seeds_and_places_say_so(drawn: Compared) -> None:
    def outcomes(found: Compared) -> dict[str, tuple[str, int]]:
        return {one.worse: (one.outcome, one.seeds) for v in found.verdicts("ours") for one in v.comparisons}

    assert outcomes(drawn)["das"] == ("confirmed", 5)
    assert outcomes(drawn)["theirs"][1] == 5  # nobody optimized it here: it is what it is
    optimized = replace(drawn, attacked={**drawn.attacked, "theirs": frozenset({"yolov3-tiny"})})
    assert outcomes(optimized)["theirs"] == ("undecided", 1)
    with pytest.raises(RaucaError, match="--lowest mine: no such row; choose one of normal, das"):
        drawn.verdicts("mine")
    everything = {row: frozenset({"yolov3-tiny", "yolov8n"}) for row in drawn.rows}
    with pytest.raises(RaucaError, match="every detector took part in an attack"):
        replace(drawn, attacked=everything).verdicts("ours")


def test_the_order_of_others_is_held_against_ours(drawn: Compared) -> None:
    order = {"normal": 0.9, "das": 0.7, "fca": 0.6, "dta": 0.2, "random": 0.1}
    assert drawn.rank_correlation(order) == (1.0, 4)
    assert drawn.rank_correlation({name: 1 - ap for name, ap in order.items()}) == (-1.0, 4)
    assert drawn.rank_correlation({**order, "dta": 0.65})[0] == pytest.approx(0.8)  # two neighbors change places
    assert drawn.rank_correlation({"normal": 1, "das": 0.5}) is None


def test_published_means_are_those_of_the_printed_detectors() -> None:
    means = published_means()
    assert set.intersection(*map(set, means.values())) >= {"normal", "das", "fca", "dta", "active", "rauca-final"}
    assert means["R-PGA, arXiv 2603.26067"]["rauca-final"] == pytest.approx(0.133, abs=5e-4)
    assert means["the paper, Table 3"]["active"] == pytest.approx((0.220 + 0.230) / 2, abs=2e-3)


def left_half(images: Tensor) -> list[dict[str, NDArray[np.float64]]]:
    """A detector that finds a car wherever the picture is."""
    box = np.array([[0.0, 0.0, images.shape[3] / 2, images.shape[2]]])
    return [{"boxes": box, "scores": np.array([0.5]), "labels": np.array([0])} for _ in images]


@pytest.fixture
def study(scene, detectors: list[Detector], tmp_path: Path) -> Study:  # type: ignore[no-untyped-def]
    """Two seeds of ours against yolov4-tiny and random paint, judged by it, a relative and a small network."""
    judges = [*detectors, load_detector(left_half, names=("car",))]
    paints = {"normal": scene.dataset.folder, **dict.fromkeys(("random", "ours s0", "ours s1"), scene.noise)}
    results = measure(scene.dataset, paints, judges, tmp_path / "seen")
    named = {}
    for number, paint in enumerate(("random", "ours s0", "ours s1")):
        named[paint] = tmp_path / f"{paint}.json"
        made = {"detector": "yolov4-tiny"} if number else {}
        record = Camouflage(paint, "box", scene.dataset.plan.atlas_id, 8, "plain", made)
        save_camouflage(named[paint], record, png_bytes(np.full((8, 8, 3), number, np.uint8)))
    entry = Entry("seen", "none", "box", "car", results, tmp_path / "seen", scene.dataset.folder, named)
    return Study("rauca evaluate <it>", (entry,))


def test_a_page_holds_the_rows_of_two_studies(study: Study, tmp_path: Path) -> None:
    shutil.copytree(tmp_path / "seen", tmp_path / "again")
    again = replace(study, entries=(replace(study.entries[0], folder=tmp_path / "again"),))
    found = compare({"street": study, "paper": again})
    assert found.scores.weathers == ("street, seen", "paper, seen")
    assert found.rows == {"normal": ["normal"], "random": ["random"], "ours": ["ours s0", "ours s1"]}
    assert (found.relatives, found.judges) == (["yolov2-tiny"], ["left_half"])
    table = study.entries[0].results.table
    assert found.ap("ours", ["yolov4-tiny"]).ap == pytest.approx(table["ours s0"]["yolov4-tiny"].ap)
    alone = compare({"street": study, "paper": again}, ["normal", "random"])
    assert (list(alone.rows), alone.relatives) == (["normal", "random"], [])  # nothing of these was attacked
    assert set(alone.judges) == set(table["normal"])
    page, *_ = write_compared(found, tmp_path / "compared.html", "rauca compare street <paper>", found.verdicts("ours"))
    read = whole_page(page)
    for text in ("rauca compare street <paper>", "Is ours below the others?", "street, seen", f"town {found.town}"):
        assert text in read.text
    stored = json.loads((tmp_path / "compared.json").read_text(encoding="utf-8"))
    assert stored["attacked"] == {"normal": [], "random": [], "ours": ["yolov4-tiny"]}
    assert stored["judges"] == ["left_half"]


def test_the_command_takes_rows_and_tells_them(study: Study, tmp_path: Path) -> None:
    save_study(tmp_path / "study" / "study.json", study.command, study.entries)
    out = tmp_path / "page.html"
    asked = ["compare", str(tmp_path / "study"), "--rows", "normal,ours", "--lowest", "ours", "--out", str(out)]
    shown = CliRunner().invoke(app, asked)
    assert shown.exit_code == 0
    assert "family of an" in shown.output
    assert "random" not in shown.output
    assert "ours below normal: " in shown.output
    assert "Is ours below the others?" in whole_page(out).text


def elsewhere(entry: Entry, **changes: Any) -> Study:
    """A study of one entry, whose results lie in a folder of their own."""
    return Study("", (replace(entry, folder=entry.folder / "elsewhere", **changes),))


def test_what_cannot_be_compared_is_refused(study: Study, tmp_path: Path) -> None:
    (entry,) = study.entries
    with pytest.raises(RaucaError, match=r"--rows mine: no such row; choose of normal, random, ours"):
        compare({"a": study}, ["ours", "mine"])
    with pytest.raises(RaucaError, match="given twice"):
        compare({"a": study, "b": study})
    fewer = replace(entry.results, detectors=dict(list(entry.results.detectors.items())[:1]))
    with pytest.raises(RaucaError, match="judged by other detectors"):
        compare({"a": study, "b": elsewhere(entry, results=fewer)})
    other = tmp_path / "other.json"
    save_camouflage(other, Camouflage("other", "box", "a", 8, "plain"), png_bytes(np.zeros((8, 8, 3), np.uint8) + 9))
    with pytest.raises(RaucaError, match="of other camouflages than"):
        compare({"a": study, "b": elsewhere(entry, camouflages={**entry.camouflages, "random": other})})
    fewer_paints = elsewhere(entry, camouflages={**entry.camouflages, "random": other})
    assert list(compare({"a": study, "b": fewer_paints}, ["normal", "ours"]).rows) == ["normal", "ours"]
    with pytest.raises(RaucaError, match=r"of the van, .* of the box; compare each apart"):
        compare({"a": study, "b": elsewhere(entry, vehicle="van")})
    with pytest.raises(RaucaError, match="of composed pictures or of rendered views"):
        compare({"a": study, "b": elsewhere(entry, results=replace(entry.results, composed=True))})
    with pytest.raises(RaucaError, match="does not say which views"):
        compare({"a": elsewhere(entry, views=None)})
    with pytest.raises(RaucaError, match="nothing was evaluated without a defence"):
        compare({"a": elsewhere(entry, defence="lgs")})
