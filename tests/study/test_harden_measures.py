"""A hardening from the first round to its record, on drawn frames; a stand-in draws what Blender would render."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from benchmarks.stability.detectors import SmallDetector
from benchmarks.stability.drawn import make_dataset
from rauca_core.attack import random_camouflage
from rauca_core.contract import LedgerEntry, Vehicle, append_entry, load_camouflage, load_vehicle, read_plan
from rauca_core.contract.files import file_digest
from rauca_core.contract.towns import VALIDATION
from rauca_core.detect.agreement import Agreement
from rauca_core.detect.load import resolve
from rauca_core.detect.synth.card import load_network, read_card
from rauca_core.report import write_hardening
from rauca_core.runtime.images import read_image
from rauca_core.study.engine import Engine, open_engine
from rauca_core.study.harden import Hardened, harden
from rauca_core.study.harden_measures import Measures
from rauca_core.study.harden_rounds import attack_folder, hardening
from rauca_core.study.interpolated import Interpolation
from rauca_core.study.job import Machine
from rauca_core.study.study import load_study
from rauca_core.study.views import HeldOut
from rauca_core.training.interpolation import Pictures
from rauca_core.training.settings import HardenSettings
from tests.study.drawn_blender import DrawnBlender, drawn_blender
from tests.study.page import whole_page

__all__ = ["drawn_blender"]
SIDES = (40.0, 130.0, 250.0)
TINY = {
    "rounds": 2, "steps": 1, "every": 1, "batch": 1, "attack_steps": 2, "attack_growth": 0.5, "attack_restarts": 2,
    "attack_patches": (5.0, 40.0), "attack_batch": 1, "map_size": 64, "samples": 2, "threads": 1,
}  # fmt: skip


@pytest.fixture
def asked(tmp_path: Path, box_vehicle: Vehicle, drawn_blender: DrawnBlender):
    """Hardens `frcnn-synth` on one vehicle, and judges it on that one and on another."""
    mirrored = replace(box_vehicle, name="mirrored", uvs=1 - box_vehicle.uvs, paint_mask=box_vehicle.paint_mask[::-1])
    folders = {}
    for name, vehicle in (("box", box_vehicle), ("mirrored", mirrored)):
        folders[name] = make_dataset(tmp_path / name, vehicle, 64, SIDES).folder
        folders[f"views-{name}"] = make_dataset(tmp_path / f"views-{name}", vehicle, 64, SIDES, light=False).folder
    body = load_vehicle(folders["box"] / "vehicle", read_image)
    random_camouflage(tmp_path / "held.json", body, 64, seed=5, cell=8)

    def run() -> Hardened:
        return harden(
            "frcnn-synth", [folders["box"]], [f"held={tmp_path / 'held.json'}"], tmp_path / "out",
            settings=HardenSettings.make(**TINY), held_out_views=HeldOut(size=64),
            interpolation=Interpolation(places=3), measures=Measures((1, 2), 2, ("dta",), (folders["mirrored"],)),
            views=[folders["views-box"], folders["views-mirrored"]],
        )  # fmt: skip

    return run


def test_every_measure_is_made_once_and_recorded(asked, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    engines: list[Engine] = []

    def opened(*given: Any, **means: Any) -> Engine:
        engines.append(open_engine(*given, **means))
        return engines[-1]

    monkeypatch.setattr("rauca_core.study.harden.open_engine", opened)
    found = asked()
    assert engines[0].made["hardened"] == 1
    # A held-out method, a held-out vehicle, and two budgets of two restarts each.
    assert engines[0].made["paint"] == 1 + 1 + 2 * 2
    record = json.loads((tmp_path / "out" / "hardening.json").read_text())
    for name in ("clean", "held_out", "held_out_methods", "held_out_vehicle", "adaptive_1x", "adaptive_2x"):
        assert 0 <= record[name]["low"] <= record[name]["after"] <= record[name]["high"] <= 1
    assert (record["adaptive_3x"], record["held_out_weathers"]) == (None, None)
    assert [entry["vehicle"] for entry in record["entries"]] == ["box", "mirrored"]
    (hardened,) = (tmp_path / "out" / "store" / "hardened").iterdir()
    (kept,) = (tmp_path / "out" / "store" / "interpolated").iterdir()
    going_back = json.loads((kept / "cpu.json").read_text())["cpu_minutes"]
    rounds = sum(one["cpu_minutes"] for one in record["rounds"])
    assert record["cpu_minutes"] == pytest.approx(rounds + going_back, abs=0.01)
    assert record["cpu_minutes"] > 0
    assert str(found.facts["share of what was learnt"]) in {"100%", "90%", "80%", "70%", "60%", "50%"}
    assert [one["round"] for one in record["rounds"]] == [1, 2]

    # Each budget has an attack in patches, which begins with noise, and one that leaves the held-out one's texels free.
    paints = tmp_path / "out" / "store" / "paint"
    options = {
        label: [load_camouflage(path)[0].made["settings"] for path in paints.glob(f"{label}-*/camouflage.json")]
        for label in ("adaptive-1x", "adaptive-2x")
    }
    begun = {one["natural"]["feature_cm"]: one.get("begin_with") for one in options["adaptive-1x"]}
    assert begun == {5.0: None, None: file_digest(tmp_path / "held.png")}
    assert {one["natural"]["feature_cm"] for one in options["adaptive-2x"]} == {5.0, None}

    attacks = tmp_path / "out" / "attacks"
    whole = {name: load_camouflage(attacks / name / "camouflage.json")[0].made for name in ("box/method-dta",)}
    assert whole["box/method-dta"]["steps"] == 10  # two rounds of two restarts, of 2 and 3 steps
    assert load_camouflage(attacks / "mirrored" / "unseen-vehicle" / "camouflage.json")[0].method == "ours"
    assert set(found.study.of(vehicle="box")[0].results.paints) == {
        "normal", "random", "held", "method-dta", "adaptive-1x", "adaptive-2x"
    }  # fmt: skip

    pool = sorted(path.relative_to(hardened).as_posix() for path in hardened.glob("round-*/attack/**/camouflage.json"))
    assert pool == [
        f"round-{number}/attack/{restart}camouflage.json" for number in (1, 2) for restart in ("", "restart-1/")
    ]
    assert [load_camouflage(hardened / path)[0].made["steps"] for path in pool] == [2, 2, 3, 3]
    # The second attack of the second round goes on from the one of the first; the first ones begin with noise.
    begun = [load_camouflage(hardened / path)[0].made["settings"].get("begin_with") for path in pool]
    assert begun == [None, None, None, file_digest(hardened / "round-1" / "attack" / "restart-1" / "camouflage.png")]
    # Patches of 40 cm leave fewer borders than those of 5, on the same box.
    borders = [
        np.abs(np.diff(read_image((hardened / path).with_suffix(".png")).astype(int), axis=1)).mean() for path in pool
    ]
    assert borders[1] < borders[0]
    assert borders[3] < borders[2]

    page, *_ = write_hardening(found, tmp_path / "out" / "report.html")
    text = whole_page(page).text
    assert all(words in text for words in ("held-out methods", "held-out vehicle", "adaptive, 1 times the budget"))
    asked()
    assert engines[1].made == Counter()


def test_other_objects_are_looked_at_in_places_of_their_own(
    tmp_path: Path, box_vehicle: Vehicle, drawn_blender: DrawnBlender
) -> None:
    """A view of each place, in the vehicle's own paint, in a town where nothing else is judged; none beside views."""
    data = make_dataset(tmp_path / "box", box_vehicle, 64, SIDES).folder
    random_camouflage(tmp_path / "held.json", load_vehicle(data / "vehicle", read_image), 64, seed=5, cell=8)
    views = make_dataset(tmp_path / "views", box_vehicle, 64, SIDES, light=False).folder

    def asked(**given: Any) -> dict[str, Any]:
        harden(
            "frcnn-synth", [data], [f"held={tmp_path / 'held.json'}"], tmp_path / "out",
            settings=HardenSettings.make(**TINY), interpolation=Interpolation(0.0),
            measures=Measures(budgets=(), other_places=3), **given,
        )  # fmt: skip
        return json.loads((tmp_path / "out" / "hardening.json").read_text())

    assert asked(views=[views])["other_places"] == {}
    assert not drawn_blender.frames["make_dataset"]
    record = asked(weathers=["both"], held_out_views=HeldOut(frames=2, size=64))
    assert set(record["other_places"]) == {"seen", "unseen"}
    assert drawn_blender.frames["make_dataset"] == 2 * (2 + 3)
    judged, more = (load_study(tmp_path / "out" / name) for name in ("study", "other_places"))
    for entry in more.entries:
        assert set(entry.results.paints) == {"normal"}
        assert {row.id.split("-")[0] for row in entry.results.frames} == {"L00", "L01", "L02"}
    towns = [{read_plan(entry.views).seed for entry in study.entries} for study in (judged, more)]
    assert not towns[0] & towns[1]


def test_what_is_kept_is_decided_in_validation_places_and_costs_no_training(
    tmp_path: Path, box_vehicle: Vehicle, drawn_blender: DrawnBlender, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A detector that never agrees goes back to half of what it learnt, in weights; none is asked for: all of it."""
    data = make_dataset(tmp_path / "box", box_vehicle, 64, SIDES).folder
    random_camouflage(tmp_path / "held.json", load_vehicle(data / "vehicle", read_image), 64, seed=5, cell=8)
    views = make_dataset(tmp_path / "views", box_vehicle, 64, SIDES, light=False).folder
    out = tmp_path / "out"

    def asked(agreement: float) -> Hardened:
        return harden(
            "frcnn-synth", [data], [f"held={tmp_path / 'held.json'}"], out, settings=HardenSettings.make(**TINY),
            interpolation=Interpolation(agreement, 3), measures=Measures(budgets=()), views=[views],
            held_out_views=HeldOut(size=64),
        )  # fmt: skip

    def weights() -> dict[str, Tensor]:
        return load_network(out / "hardened-frcnn-synth.safetensors")[0].state_dict()

    assert "share of what was learnt" not in asked(0.0).facts
    assert not drawn_blender.frames["make_dataset"]
    learnt = weights()
    assert asked(0.97).facts["share of what was learnt"] == "100%"  # so little was learnt that nothing changed
    (shown,) = (out / "store" / "views").iterdir()
    plan = read_plan(shown)
    assert plan.seed in VALIDATION.values()
    assert plan.weathers == read_plan(data).weathers
    assert len(list((shown / "frames").iterdir())) == plan.locations == drawn_blender.frames["make_dataset"] == 3
    assert all(torch.equal(value, learnt[name]) for name, value in weights().items())

    hidden = next((shown / "frames").iterdir())  # Blender renders none where the vehicle is not to be seen
    shutil.rmtree(hidden)
    append_entry(shown, LedgerEntry(hidden.name, "occluded"))
    monkeypatch.setattr(Pictures, "agreements", lambda *_: [Agreement(9, 10, 4, 5)] * 2)
    found = asked(0.98)
    first = load_network(resolve("frcnn-synth").files[0])[0].state_dict()
    assert any(not torch.allclose(value, first[name], rtol=2e-3) for name, value in learnt.items())
    for name, value in weights().items():
        middle = torch.lerp(first[name], learnt[name], 0.5).half() if value.is_floating_point() else learnt[name]
        assert torch.allclose(value, middle.to(value.dtype), rtol=1e-3)  # the file is of half precision
    assert found.facts["share of what was learnt"] == "50%"
    assert found.facts["in the places that decided it"] == "18 of 20 other objects as before"
    card = read_card((out / "hardened-frcnn-synth.json").resolve())[0].hardened
    assert (card["share_of_weights"], card["agreed"], card["objects"], card["rounds"]) == (0.5, 18, 20, 2)
    assert drawn_blender.frames["make_dataset"] == 3
    assert [len(list((out / "store" / kind).iterdir())) for kind in ("hardened", "interpolated")] == [1, 2]


@pytest.mark.parametrize("restarts", [1, 2])
def test_the_attack_that_grows_begins_with_a_given_camouflage(
    tmp_path: Path, box_vehicle: Vehicle, restarts: int
) -> None:
    data = make_dataset(tmp_path / "box", box_vehicle, 64, SIDES).folder
    for name in ("given", "second"):
        random_camouflage(tmp_path / f"{name}.json", load_vehicle(data / "vehicle", read_image), 128, seed=5, cell=8)
    out, given = tmp_path / "out", [str(tmp_path / f"{name}.json") for name in ("given", "second")]
    options = {
        "detector": "frcnn-synth", "datasets": [str(data)], "attacked": [str(data)], "camouflages": given,
        "settings": {**TINY, "attack_restarts": restarts}, "command": "",
    }  # fmt: skip
    attack = hardening(options, out, Machine(threads=1)).attack
    grown = []
    for number in (1, 2):
        *others, last = attack(SmallDetector(), number, attack_folder(out, number, 0))
        for path in others:
            made = load_camouflage(path)[0].made["settings"]
            assert (made.get("begin_with"), made["natural"]["feature_cm"]) == (None, 5.0)
        assert len(others) == restarts - 1
        grown.append(last)
    made = [load_camouflage(path)[0].made["settings"] for path in grown]
    digests = [file_digest(Path(path).with_suffix(".png")) for path in (given[0], grown[0])]
    assert [one["begin_with"] for one in made] == digests
    assert [one["natural"]["feature_cm"] for one in made] == [None, None]
