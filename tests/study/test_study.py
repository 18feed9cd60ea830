"""study.json: evaluations of one study under a common name."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rauca_core.contract import Camouflage, RaucaError, save_camouflage
from rauca_core.contract.files import png_bytes
from rauca_core.study.results import load_results, save_results
from rauca_core.study.study import Entry, load_study, save_study
from tests.study.measured import made_up


def saved(folder: Path) -> list[Entry]:
    entries = []
    for seed, (weathers, defence) in enumerate((("seen", "none"), ("seen", "lgs"), ("unseen", "none"))):
        results = made_up(seed, ("normal",), ("yolo",))
        into = folder / "sedan" / weathers / defence
        save_results(into / "results.json", results)
        camouflages = {"rauca": folder / "camouflages" / "rauca.json"}
        views = folder / "sedan" / weathers / "views"
        entries.append(Entry(weathers, defence, "sedan", "car", results, into, views, camouflages))
    made = Camouflage("rauca", "sedan", "0" * 16, 8, "rauca", {"detector": "yolo"})
    save_camouflage(folder / "camouflages" / "rauca.json", made, png_bytes(np.zeros((8, 8, 3), np.uint8)))
    save_study(folder / "study.json", "rauca evaluate --out study", entries)
    return entries


def test_a_study_survives_the_disk_and_a_move(tmp_path: Path) -> None:
    entries = saved(tmp_path / "study")
    study = load_study(tmp_path / "study")
    assert study.command == "rauca evaluate --out study"
    assert list(study.entries) == entries
    assert study.of(defence="none") == (study.entries[0], study.entries[2])
    assert json.loads((tmp_path / "study" / "study.json").read_text())["entries"][0]["parts"] == {"attacked": ["yolo"]}
    assert "/" not in json.loads((tmp_path / "study" / "study.json").read_text())["entries"][0]["results"][:1]
    (tmp_path / "study").rename(tmp_path / "moved")
    assert load_study(tmp_path / "moved" / "study.json").entries[1].results == replace(entries[1].results)
    save_study(tmp_path / "moved" / "study.json", "x", load_study(tmp_path / "moved").entries, {"title": "T"})
    assert load_study(tmp_path / "moved").notes == {"title": "T"}


def test_damaged_studies_are_named(tmp_path: Path) -> None:
    saved(tmp_path)
    path = tmp_path / "study.json"
    written = json.loads(path.read_text())
    first = written["entries"][0]
    for change, complaint in [
        ({"version": 3}, "reads 2; update rauca"),
        ({"version": 1}, "reads 2; run the command that made it again, in the same folder"),
        ({"entries": []}, "entries must be at least one"),
        ({"entries": [first, first]}, "each of its own vehicle, weathers and defence"),
        ({"entries": [first | {"results": "gone.json"}]}, "gone.json: not found"),
        ({"entries": [first | {"color": 1}]}, r"entries\[0\]: unknown field color"),
        ({"entries": [first | {"camouflages": {"rauca": 3}}]}, "rauca must be text"),
    ]:
        path.write_text(json.dumps(written | change))
        with pytest.raises(RaucaError, match=complaint):
            load_study(path)
    path.unlink()
    with pytest.raises(RaucaError, match=r"study\.json: not found"):
        load_study(path)


def test_results_survive_the_disk(tmp_path: Path) -> None:
    results = made_up(0, ("normal", "ours"), ("yolo",))
    save_results(tmp_path / "results.json", results)
    assert load_results(tmp_path / "results.json") == results


@pytest.mark.parametrize(
    ("place", "bad", "complaint"),
    [
        (("version",), 6, "reads 5; update rauca"),
        (("version",), 4, "reads 5; run the command that made it again, in the same folder"),
        (("table",), {}, "table and detectors do not fit"),
        (("images",), {}, "images and frames do not fit"),
        (("settings", "color"), 1, "settings: unknown field color"),
        (("surplus",), 1, "unknown field surplus"),
        (("table", "normal", "yolo", "ap"), None, "table: normal: yolo: ap must be a finite number"),
        (("groups", "azimuth_deg", 0, "value"), "x", r"groups: azimuth_deg\[0\]: value must be a finite number"),
        (("images", "normal", 0, "sha256"), ["0" * 64], r"images: normal\[0\]: sha256 must be text"),
    ],
)
def test_damaged_results_are_refused(tmp_path: Path, place: tuple[Any, ...], bad: object, complaint: str) -> None:
    path = tmp_path / "results.json"
    save_results(path, made_up(0, ("normal",), ("yolo",)))
    written = json.loads(path.read_text())
    *way, last = place
    inner = written
    for key in way:
        inner = inner[key]
    inner[last] = bad
    path.write_text(json.dumps(written))
    with pytest.raises(RaucaError, match=rf"results\.json: .*{complaint}"):
        load_results(path)
