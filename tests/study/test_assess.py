"""An assessment over a small battery; a stand-in draws what Blender would render."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from rauca_core.attack import random_camouflage
from rauca_core.contract import Camera, Camouflage, Clips, Plan, RaucaError, Ring, load_vehicle, save_camouflage
from rauca_core.contract.files import file_digest, png_bytes, write_json
from rauca_core.detect import load_detector
from rauca_core.pictures.add import add_picture
from rauca_core.runtime.images import read_image
from rauca_core.study import assess as assessing
from rauca_core.study import battery as batteries
from rauca_core.study import recipes
from rauca_core.study.assess import INFORMED, WHITE_BOX, Driving, Effort, assess, strongest, works_of
from rauca_core.study.assessment import load_assessment
from rauca_core.study.battery import Battery, BatteryVehicle, BatteryViews
from rauca_core.study.candidates import NORMAL, RANDOM, find_vehicles
from rauca_core.study.cost import cost_of
from rauca_core.study.evaluate import RandomPaint
from rauca_core.study.makers import CAMOUFLAGE
from rauca_core.study.study import load_study
from rauca_core.study.views import weathers_named
from tests.study.drawn_blender import DrawnBlender, drawn_blender

__all__ = ["drawn_blender"]
LABELS = ("theirs", "mine")


@pytest.fixture
def small_battery(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, detectors) -> Path:
    """One vehicle, two sets of four views, two camouflages, of which one was made against the first detector."""
    monkeypatch.setattr(batteries, "library_folder", lambda: tmp_path / "library")
    monkeypatch.setattr(assessing, "user_cache", lambda: tmp_path / "cache")
    monkeypatch.setattr(assessing, "MAP_SIZE", 64)
    monkeypatch.setattr(assessing, "EFFORTS", {"quick": Effort(2, 2)})
    (choice,) = find_vehicles(["sedan"])
    body = load_vehicle(choice.folder, read_image)
    maps = {}
    for seed, label in enumerate(LABELS, start=5):
        path = tmp_path / "library" / "sedan" / f"{label}.json"
        random_camouflage(path, body, size=64, seed=seed, cell=8)
        maps[label] = file_digest(path.with_suffix(".png"))
    ring = Ring((0.0, 90.0), (10.0,), (6.0,))
    plan = Plan.of(weathers_named("demo")[:2], ring, name="battery", size=192, light=False, locations=2, seed=7)
    views = [
        BatteryViews(name, dataclasses.replace(plan, seed=seed), {"quick": 4, "standard": 6, "overnight": 8})
        for name, seed in (("near", 7), ("far", 8))
    ]
    battery = Battery(
        "small", "car", (BatteryVehicle("sedan", recipes.vehicle_in(choice.folder).settings["content"], maps),),
        {"theirs": ("f" * 16,), "mine": (detectors[0].fingerprint,)}, RandomPaint(size=64),
        dataclasses.replace(plan, light=True, seed=9), tuple(views),
    )  # fmt: skip
    write_json(tmp_path / "small.json", battery.to_json())
    return tmp_path / "small.json"


def test_an_assessment_holds_all_that_engineers_act_on(
    small_battery: Path,
    drawn_blender: DrawnBlender,
    detectors,
    tmp_path: Path,
) -> None:
    found, study = assess(detectors[0], tmp_path / "out", battery=str(small_battery), defences=["jpeg:quality=50"])
    assert found == load_assessment(tmp_path / "out" / "assess.json")
    paints = {NORMAL, RANDOM, *LABELS, WHITE_BOX}
    for by_paint in (found.worst_cell, found.worst_tenth, found.errors, found.range_m):
        assert set(by_paint) == paints
    assert found.clean.frames == 8
    assert found.clean.ap > 0.3  # it sees the drawn car
    assert found.clean.low <= found.clean.ap <= found.clean.high
    # What was made against this very detector says nothing of transfer.
    assert found.transfer == found.transfer_by_camouflage["theirs"]
    assert found.transfer.frames == 8
    assert {mistakes.targets for mistakes in found.errors.values()} == {8}
    assert found.clean.recall == found.errors[NORMAL].recall
    (defence,) = found.defences
    assert found.defences[defence].informed is not None
    assert (tmp_path / "out" / "attacks" / "sedan" / f"{INFORMED}jpeg-quality-50").is_symlink()
    ranked = (tmp_path / "cache" / "ranking").glob("*/ranking.json")
    means, behind = sorted((json.loads(path.read_text())["means"] for path in ranked), key=len)
    assert len(behind) == len(LABELS) + 1  # behind the defence, with the one made against the bare detector
    assert len(means) == len(LABELS)
    assert all(0 <= mean <= 1 for mean in means)
    assert set(found.without_place) == {"clean", "random", "transfer", "white_box"}
    assert "one run of 2 steps on 2 views" in found.white_box_note
    assert {entry.weathers for entry in study.entries} == {"near", "far"}
    assert json.loads((tmp_path / "out" / "assess.json").read_text())["detector"]["differentiable"] is True


def test_the_cost_of_clips_is_told_beforehand() -> None:
    asked = Driving(Clips(("approach", "passing"), 10), ("demo",))  # of two vehicles, in three weathers
    still, driven = works_of()["quick"], works_of(clips=asked)["quick"]
    assert driven == dataclasses.replace(still, driven=2 * 20 * 3)
    costs = [cost_of(work, ms_forward=1000.0, ms_step=None, cores=1) for work in (still, driven)]
    assert costs[1].look_s - costs[0].look_s == 120 * 4  # plain, random, the worst of the library, the detector's own
    assert costs[1].render_s > costs[0].render_s + 120 * 2
    assert costs[1].attack_s == costs[0].attack_s


def test_of_several_runs_the_strongest_is_worn(tmp_path: Path) -> None:
    record = Camouflage("white-box", "sedan", "a", 16, "ours")
    for name, score in (("first", 0.4), ("second", 0.1), ("third", 0.3)):
        made = {"final_losses": {"score": score}}
        save_camouflage(tmp_path / name / CAMOUFLAGE, dataclasses.replace(record, made=made), b"")
    assert strongest([tmp_path / name for name in ("first", "second", "third")]) == tmp_path / "second"


def test_the_next_detector_finds_the_renders_in_the_cache(
    small_battery: Path,
    drawn_blender: DrawnBlender,
    detectors,
    tmp_path: Path,
) -> None:
    options = {"battery": str(small_battery), "white_box": False}
    first, _ = assess(detectors[0], tmp_path / "first", **options)
    drawn = drawn_blender.frames.copy()
    assert drawn == {"make_dataset": 8, "render_camouflages": 24}
    second, _ = assess(detectors[1], tmp_path / "second", **options)
    assert drawn_blender.frames == drawn
    assert (first.white_box, first.white_box_note) == (None, "it was not asked for")
    assert second.detector.sha256 != first.detector.sha256
    again, _ = assess(detectors[0], tmp_path / "again", **options)
    assert dataclasses.replace(again, seconds={}, detector=first.detector) == dataclasses.replace(first, seconds={})


def test_a_changed_vehicle_or_library_is_refused(small_battery: Path, detectors, tmp_path: Path) -> None:
    fields = json.loads(small_battery.read_text())
    other = tmp_path / "other.json"
    changed = [{**fields["vehicles"][0], "content": "0"}]
    other.write_text(json.dumps({**fields, "vehicles": changed}))
    with pytest.raises(RaucaError, match="is another vehicle than the one small was made for"):
        assess(detectors[0], tmp_path / "out", battery=str(other))
    (tmp_path / "library" / "sedan" / "mine.png").write_bytes(
        (tmp_path / "library" / "sedan" / "theirs.png").read_bytes()
    )
    with pytest.raises(RaucaError, match=r"mine\.png: is not the map that small was made with"):
        assess(detectors[0], tmp_path / "out", battery=str(small_battery))
    with pytest.raises(RaucaError, match="--vehicle boat: not one of small; choose of sedan"):
        assess(detectors[0], tmp_path / "out", battery=str(small_battery), vehicles=["boat"])


def test_a_function_gets_the_figures_of_the_detector_that_it_wraps(
    small_battery: Path, drawn_blender: DrawnBlender, detectors, tmp_path: Path
) -> None:
    inner = detectors[0]

    def black_box(images: torch.Tensor) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        return [(f.boxes.numpy(), f.scores.numpy(), f.labels.numpy()) for f in inner.detect(images)]

    options = {"battery": str(small_battery)}
    wrapped = load_detector(black_box, names=inner.class_names, name="wrapped")
    outside, _ = assess(wrapped, tmp_path / "outside", **options)
    inside, _ = assess(inner, tmp_path / "inside", white_box=False, **options)
    assert outside.transfer_by_camouflage == inside.transfer_by_camouflage
    assert outside.errors == inside.errors
    assert outside.white_box is None
    assert not outside.detector.differentiable
    assert "gradient" in outside.white_box_note


def test_pictures_are_looked_at_in_a_study_of_their_own(
    small_battery: Path, drawn_blender: DrawnBlender, detectors, tmp_path: Path
) -> None:
    camera = Camera.look_at(np.array([5.0, 4.0, 2.5]), np.array([0.0, 0, 0.7]), 60.0, 160, 120)
    (tmp_path / "camera.json").write_text(json.dumps(camera.to_json()))
    noise = np.random.default_rng(0).integers(90, 110, (120, 160, 3), np.uint8)
    (tmp_path / "car.png").write_bytes(png_bytes(noise))
    sedan, pictures = load_vehicle(find_vehicles(["sedan"])[0].folder, read_image), tmp_path / "photographs"
    add_picture(tmp_path / "car.png", sedan, pictures, camera=tmp_path / "camera.json")
    told = {"battery": str(small_battery), "white_box": False}
    found, study = assess(detectors[0], tmp_path / "out", pictures=[pictures], **told)
    assert found.clean.frames == 8  # the battery's alone
    assert not any(entry.results.composed for entry in study.entries)
    (entry,) = load_study(tmp_path / "out" / "pictures").entries
    assert entry.weathers == "photographs, composed"
    assert entry.results.composed
    assert set(entry.results.table) == {NORMAL, RANDOM, *LABELS}
    with pytest.raises(RaucaError, match="was rendered; `rauca evaluate` takes it"):
        assess(detectors[0], tmp_path / "again", pictures=[study.entries[0].views], **told)
