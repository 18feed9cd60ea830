"""Composed frames: who may learn from them, and that whoever judges refuses them with one line."""

from __future__ import annotations

import ast
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

import benchmarks.agreement
import benchmarks.views_agreement
from benchmarks.agreement import measure_agreement
from benchmarks.defences import read_views
from benchmarks.stability.drawn import painted_box
from benchmarks.views import _measure
from rauca_core.attack import random_camouflage
from rauca_core.contract import Dataset, RaucaError, Vehicle
from rauca_core.environment.extractor import LightSplitter
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.metrics import compare
from rauca_core.environment.place_light import light_places
from rauca_core.environment.views import Views, densify
from rauca_core.study.detecting import pictures_in
from rauca_core.study.evaluate import open_views
from rauca_core.study.ranking import rank_camouflages
from rauca_core.training.extractor_fit import Fit, fit
from rauca_core.training.fit import Given, describe
from rauca_core.training.harden import Hardening, _Rounds
from rauca_core.training.hardenable import origin_of
from rauca_core.training.settings import ExtractorSettings, HardenSettings
from tests.environment.room import make_room

torch.set_num_threads(1)

JUDGES = "judges: refuses composed frames"
JUDGES_PICTURES = "judges: pictures apart from rendered frames, and refuses what was composed from others"
LEARNS = "learns from any frame, composed ones too"
SPLITS = "learns from any frame, and holds out rendered ones alone"
READS = "shows, checks or hands on what is there, whatever it is"
RULES = "is the rule itself"
MAKES = "opens what it has just had rendered, or what another room of this list let in"
OPENS = {
    "benchmarks/agreement.py": JUDGES,
    "benchmarks/defences.py": JUDGES,
    "benchmarks/detect.py": READS,  # two implementations of one network on the same pixels
    "benchmarks/environment.py": MAKES,
    "benchmarks/environment_in_blender.py": MAKES,
    "benchmarks/in_blender.py": MAKES,
    "benchmarks/motion.py": MAKES,
    "benchmarks/stability/drawn.py": MAKES,
    "benchmarks/stability/optimizer.py": MAKES,
    "benchmarks/vehicle.py": MAKES,
    "benchmarks/views.py": JUDGES,
    "benchmarks/views_agreement.py": JUDGES,
    "pipelines/dataset_commands.py": READS,  # `densify`, where `Views` refuses
    "pipelines/tradeoff.py": LEARNS,
    "rauca_core/attack/optimizer.py": LEARNS,
    "rauca_core/attack/renderer.py": LEARNS,
    "rauca_core/contract/dataset.py": RULES,
    "rauca_core/dataset_tools/check.py": READS,
    "rauca_core/dataset_tools/export.py": READS,
    "rauca_core/dataset_tools/recoloring.py": READS,
    "rauca_core/dataset_tools/view.py": READS,
    "rauca_core/environment/frames.py": SPLITS,
    "rauca_core/environment/metrics.py": JUDGES,
    "rauca_core/environment/place_light.py": JUDGES,  # it fits, and tells the error on a view left out
    "rauca_core/environment/views/densify.py": MAKES,
    "rauca_core/environment/views/drawn.py": JUDGES,  # nothing is composed from composed frames
    "rauca_core/report/pictures.py": MAKES,
    "rauca_core/study/camouflaged.py": READS,
    "rauca_core/study/compare.py": READS,  # the town of views that `evaluate` has opened
    "rauca_core/study/datasets.py": MAKES,
    "rauca_core/study/demo.py": MAKES,
    "rauca_core/study/assess.py": JUDGES_PICTURES,
    "rauca_core/study/detecting.py": JUDGES_PICTURES,
    "rauca_core/study/evaluate.py": JUDGES_PICTURES,  # of `harden` as well, which takes no pictures: `--views`
    "rauca_core/study/driven.py": READS,  # clips of views that `evaluate` has opened
    "rauca_core/study/harden.py": LEARNS,
    "rauca_core/study/harden_measures.py": LEARNS,
    "rauca_core/study/harden_rounds.py": LEARNS,
    "rauca_core/study/interpolated.py": MAKES,
    "rauca_core/study/judging.py": MAKES,
    "rauca_core/study/makers.py": MAKES,
    "rauca_core/study/ranking.py": JUDGES,
    "rauca_core/study/recipes.py": LEARNS,
    "rauca_core/study/scores.py": JUDGES_PICTURES,
    "rauca_core/study/tradeoff.py": LEARNS,
    "rauca_core/training/extractor_fit.py": SPLITS,
    "rauca_core/training/fit.py": JUDGES,  # data sets to test on; what it trains on is split by `frames.py`
    "rauca_core/training/harden.py": SPLITS,
    "tools/make_battery.py": MAKES,
    "tools/preflight_pictures.py": MAKES,
    "tools/thumbnails.py": MAKES,
}
REPOSITORY = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return replace(painted_box(), category="car")


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory, vehicle: Vehicle) -> Dataset:
    return make_room(tmp_path_factory.mktemp("rendered") / "room", vehicle, (0.0, 90.0, 180.0, 270.0), locations=2)


@pytest.fixture(scope="module")
def dense(tmp_path_factory: pytest.TempPathFactory, room: Dataset) -> Dataset:
    return densify(Views(room, 6), tmp_path_factory.mktemp("composed") / "dense")


def calls(path: Path) -> set[str]:
    found = (node.func for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call))
    return {node.id if isinstance(node, ast.Name) else getattr(node, "attr", "") for node in found}


def test_whoever_opens_a_data_set_has_decided_what_composed_frames_are_to_him() -> None:
    asked = {"Dataset", "LightFrames", "require_rendered", "require_rendered_or_pictured"}
    rooms = ("rauca_core", "benchmarks", "pipelines", "tools")
    found = {path: calls(path) for name in rooms for path in sorted((REPOSITORY / name).rglob("*.py"))}
    opening = {path.relative_to(REPOSITORY).as_posix(): some for path, some in found.items() if some & asked}
    assert sorted(opening) == sorted(OPENS)
    refusing = {name for name, some in opening.items() if "require_rendered" in some}
    both = {"rauca_core/contract/dataset.py", "rauca_core/study/evaluate.py"}
    assert refusing - both == {name for name, use in OPENS.items() if use == JUDGES}
    telling = {name for name, some in opening.items() if "require_rendered_or_pictured" in some}
    assert telling == {name for name, use in OPENS.items() if use == JUDGES_PICTURES}


JUDGING: dict[str, Callable[[Path, Path], Any]] = {
    "evaluate": lambda data, worn: open_views([data], pictures=True),
    "harden --views": lambda data, worn: open_views([data]),
    "detections": lambda data, worn: pictures_in(data, []),
    "efe evaluate": lambda data, worn: compare([data], LightSplitter(), [(1, 2, 3)], lambda progress: None),
    "rank_camouflages": lambda data, worn: rank_camouflages(data, [worn], SimpleNamespace(), "car"),
    "--test": lambda data, worn: split_with_test(data),
    "dataset light": lambda data, worn: list(light_places(data)),
    "agreement": lambda data, worn: measure_agreement(Dataset(data), worn, data),
    "bench agreement": lambda data, worn: benchmarks.agreement.bench(data / "out.json", data, worn),
    "bench views": lambda data, worn: _measure(SimpleNamespace(), Dataset(data), Dataset(data), 1, 0.0),
    "bench views-agreement": lambda data, worn: benchmarks.views_agreement.bench(data / "out.json", data),
    "bench defences": lambda data, worn: read_views(data.parent),
    "new views": lambda data, worn: Views(Dataset(data), 2),
}


def split_with_test(data: Path) -> None:
    Given(datasets=[data], out=data, tests=[data]).split(LightFrames([data, data]), "location", 0.25, 0)


@pytest.mark.parametrize("judge", JUDGING)
def test_whoever_judges_refuses_composed_frames(judge: str, dense: Dataset, vehicle: Vehicle, tmp_path: Path) -> None:
    (tmp_path / "held-out").symlink_to(dense.folder)  # where a demo has its views
    random_camouflage(tmp_path / "worn.json", vehicle, 64, seed=1, cell=8)
    with pytest.raises(RaucaError, match=r"was composed from other frames, to learn from; .*rauca dataset make"):
        JUDGING[judge](tmp_path / "held-out", tmp_path / "worn.json")


def test_composed_frames_are_trained_on_and_never_tested_on(room: Dataset, dense: Dataset) -> None:
    frames = LightFrames([room.folder, dense.folder])
    train, test = frames.split("location")
    alone_train, alone_test = LightFrames([room.folder]).split("location")
    assert test == alone_test
    assert train[: len(alone_train)] == alone_train  # what is rendered falls as it does without
    composed = train[len(alone_train) :]
    hidden = {frames.places[i].frame.location for i in test}
    # A composed frame shows what its sources showed: those of the place that is held out teach nothing.
    there = [i for i, place in enumerate(frames.places) if place.frame.composed]
    assert composed == [i for i in there if frames.places[i].frame.location not in hidden]
    assert 0 < len(composed) < len(there)
    assert [row.get("composed") for row in describe(frames, test)] == [None, True]


def test_a_split_that_leaves_nothing_to_test_on_or_to_learn_from_says_what_mends_it(
    room: Dataset, dense: Dataset
) -> None:
    with pytest.raises(RaucaError, match=r"dense: every frame was composed .* give a data set of `rauca dataset make`"):
        LightFrames([dense.folder]).split("location")
    both = LightFrames([room.folder, dense.folder])
    with pytest.raises(RaucaError, match=r"dense: .* that are held out to test on; hold out whole places"):
        both.split("view")  # every frame here comes from cameras all around, those held out among them
    frames = LightFrames([dense.folder, room.folder])
    with pytest.raises(RaucaError, match=r"dense: .* held out to test on"):
        Given(datasets=[dense.folder], out=dense.folder, tests=[room.folder]).split(frames, "location", 0.25, 0)


def test_an_extractor_learns_from_composed_frames(room: Dataset, dense: Dataset, tmp_path: Path) -> None:
    settings = ExtractorSettings.make(epochs=1, batch=2, crop=32, threads=1)
    weights, outcome = fit(Fit(datasets=[room.folder, dense.folder], out=tmp_path / "efe", settings=settings))
    assert weights.is_file()
    assert len(outcome.errors) == 2
    with pytest.raises(RaucaError, match="none is left to test on"):
        fit(Fit(datasets=[dense.folder], out=tmp_path / "alone", settings=settings))


def test_a_hardening_learns_and_attacks_on_composed_frames_and_is_watched_on_rendered_ones(
    room: Dataset, dense: Dataset, vehicle: Vehicle, tmp_path: Path
) -> None:
    random_camouflage(tmp_path / "worn.json", vehicle, 64, seed=1, cell=8)

    def rounds(*data: Path) -> _Rounds:
        settings = HardenSettings.make(attack_steps=2, map_size=64, samples=2, threads=1)
        worn, out = [tmp_path / "worn.json"], tmp_path / "out"
        wanted = Hardening("frcnn-synth", data, worn, out, settings, lambda *_: out, len, attacked=data)
        return _Rounds(wanted, origin_of("frcnn-synth"))

    made = rounds(room.folder, dense.folder)
    assert any(made.frames.places[i].frame.composed for i in made.train)
    assert made.tested
    assert not any(made.frames.places[i].frame.composed for i in made.tested)
    with pytest.raises(RaucaError, match="none is left to test on"):
        rounds(dense.folder)
