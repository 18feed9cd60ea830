"""The engine of all studies: recipes, what is made and what is not, kills, damage, workers and the cache."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from benchmarks.stability.detectors import SmallDetector
from rauca_core.attack import make_settings, random_camouflage
from rauca_core.attack.paint import load_paint
from rauca_core.contract import Dataset, Plan, Progress, Quality, RaucaError, RenderCamouflages, Ring, Vehicle, Weather
from rauca_core.detect import load_detector
from rauca_core.runtime.cluster import Cluster
from rauca_core.runtime.folder_lock import alone_in
from rauca_core.runtime.images import read_image
from rauca_core.study import recipes
from rauca_core.study.artifact import RECIPE, VERSIONS, Artifact, read_recipe
from rauca_core.study.defences import make_defence
from rauca_core.study.detection_cache import DetectionSettings
from rauca_core.study.engine import Engine
from rauca_core.study.evaluate import evaluate
from rauca_core.study.executors import LOCK, OnCluster
from rauca_core.study.job import Machine
from rauca_core.study.makers import KINDS
from rauca_core.study.store import Store, kept_in, prune, store_around
from tests.detect.conftest import cfg_of, write_random_weights
from tests.faults.conftest import TINY
from tests.study.drawn_blender import DrawnBlender, drawn_blender

__all__ = ["drawn_blender"]
RING = Ring((40.0, 130.0), (12.0,), (7.0,))
WEATHERS = (Weather("day", 45.0), Weather("dusk", 5.0))


@dataclass
class Kit:
    """A plan and its vehicle, a folder for stores, and what stands for Blender."""

    plan: Plan
    vehicle: Artifact
    folder: Path
    blender: DrawnBlender

    def engine(self, store: str = "store", *parents: str) -> Engine:
        return Engine(Store(self.folder / store, [self.folder / parent for parent in parents]))

    def views(self, count: int = 4) -> Artifact:
        return recipes.data_set("views", self.plan, self.vehicle, [frame.id for frame in self.plan.frames()][:count])

    def painted(self, engine: Engine, count: int = 4) -> Artifact:
        """Renders of views in random paint; all that comes before them is made."""
        folder, paint = engine.make(self.views(count), recipes.random_paint(self.vehicle, 64, 1, 8))
        frames = [frame.id for frame in Dataset(folder).frames()][:4]
        return recipes.renders(self.views(count), recipes.camouflage_in(paint / "camouflage.json", "random-1"), frames)


@pytest.fixture
def kit(tmp_path: Path, box_vehicle: Vehicle, drawn_blender: DrawnBlender) -> Kit:
    box_vehicle.save(tmp_path / "vehicle")
    plan = Plan(
        "p", box_vehicle.name, box_vehicle.atlas_id, 48, Quality(1), True, WEATHERS, RING, 1, (140,) * 3, 0.5, 7, ""
    )
    return Kit(plan, recipes.vehicle_in(tmp_path / "vehicle"), tmp_path, drawn_blender)


def stamps(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.png")}


def test_a_name_says_all_that_an_artifact_depends_on(kit: Kit, tmp_path: Path, box_vehicle: Vehicle) -> None:
    one = kit.views()
    assert one.digest == replace(kit, plan=replace(kit.plan, name="q", blender="5.0")).views(2).digest
    assert replace(one, options={}).digest == one.digest == replace(one, label="other").digest
    replace(box_vehicle, positions=box_vehicle.positions * np.float32(0.9)).save(tmp_path / "smaller")
    others = [
        replace(kit, plan=replace(kit.plan, seed=8)).views(),
        replace(kit, plan=replace(kit.plan, quality=Quality(2))).views(),
        replace(kit, vehicle=recipes.vehicle_in(tmp_path / "smaller")).views(),
        replace(one, kind="part"),
        recipes.data_set("views", kit.plan, kit.vehicle, [], exact=True),
    ]
    assert len({one.digest, *(other.digest for other in others)}) == 6
    replace(box_vehicle, notes=["read again"]).save(tmp_path / "again")
    assert replace(kit, vehicle=recipes.vehicle_in(tmp_path / "again")).views().digest == one.digest


def test_a_version_of_a_kind_makes_it_anew(monkeypatch: pytest.MonkeyPatch, kit: Kit) -> None:
    before = kit.views().digest
    monkeypatch.setitem(VERSIONS, "views", 99)
    assert kit.views().digest != before
    assert set(VERSIONS) == {*KINDS, "map"}


def test_what_is_there_is_not_made_and_what_grows_goes_on(kit: Kit, tmp_path: Path) -> None:
    engine = kit.engine()
    renders = kit.painted(engine, 2)
    engine.make(renders)
    assert engine.made == {"views": 1, "random": 1, "renders": 1}
    assert kit.blender.frames == {"make_dataset": 2, "render_camouflages": 2}
    before = stamps(tmp_path / "store")
    again = kit.engine()
    again.make(kit.painted(again, 2))
    assert again.made == {}
    again.make(kit.painted(again, 4))
    assert kit.blender.frames == {"make_dataset": 4, "render_camouflages": 4}
    assert before.items() <= stamps(tmp_path / "store").items()


def test_what_a_kill_left_in_a_finished_artifact_is_swept(kit: Kit) -> None:
    (folder,) = kit.engine().make(kit.views())
    (folder / ".partial-recipe").write_text("{")  # killed as it noted how long the making took
    again = kit.engine()
    assert again.make(kit.views()) == (folder,)
    assert not again.made
    assert not list(folder.glob(".partial-*"))


def test_a_finished_artifact_needs_none_of_its_inputs(kit: Kit, tmp_path: Path) -> None:
    first = kit.engine("one")
    renders = kit.painted(first)
    first.make(renders)
    other = kit.engine("two", "one")
    assert other.make(renders) == first.make(renders)
    assert (other.made, (tmp_path / "two").exists()) == ({}, False)
    assert store_around(first.make(renders)[0]) == [(tmp_path / "one").resolve()]
    assert store_around(tmp_path) == []


def test_a_data_set_is_known_wherever_it_lies(kit: Kit, tmp_path: Path) -> None:
    (folder,) = kit.engine().make(kit.views())
    moved = folder.rename(tmp_path / "moved")
    assert recipes.views_in(moved).digest == kit.views().digest
    (moved / RECIPE).unlink()
    assert recipes.views_in(moved).digest == kit.views().digest


def test_damaged_and_lost_renders_are_made_again(kit: Kit, tmp_path: Path) -> None:
    engine = kit.engine()
    (folder,) = engine.make(renders := kit.painted(engine))
    whole = {path: path.read_bytes() for path in folder.glob("*.png")}
    lost, cut, *_ = whole
    lost.unlink()
    cut.write_bytes(whole[cut][:90])
    (folder / ".partial-x").write_bytes(b"killed")
    kit.engine().make(renders)
    assert {path: path.read_bytes() for path in folder.glob("*.png")} == whole
    assert kit.blender.frames["render_camouflages"] == 4 + 2
    assert not (folder / ".partial-x").exists()


def test_blenders_share_the_frames_that_are_missing(kit: Kit, monkeypatch: pytest.MonkeyPatch) -> None:
    """As many as cores, none without a frame; what lies there is in nobody's part."""
    asked: list[list[tuple[str, ...] | None]] = []

    def drawn(jobs: Sequence[RenderCamouflages], *more: Any) -> None:
        asked.append([job.frames for job in jobs])
        assert {job.threads for job in jobs} == {0 if len(jobs) == 1 else 1}
        for job in jobs:
            kit.blender(job, *more)

    monkeypatch.setattr("rauca_core.study.makers.run_blenders", drawn)
    monkeypatch.setattr("rauca_core.study.makers.cores", lambda: 3)
    monkeypatch.setattr("rauca_core.study.makers.IMAGES_A_BLENDER", 1)
    engine = kit.engine()
    (folder,) = engine.make(renders := kit.painted(engine))
    first, second, *others = sorted(path.stem for path in folder.glob("*.png"))
    (folder / f"{first}.png").unlink()
    (folder / f"{second}.png").unlink()
    kit.engine().make(renders)
    monkeypatch.setattr("rauca_core.study.makers.IMAGES_A_BLENDER", 8)
    (folder / f"{second}.png").unlink()
    kit.engine().make(renders)
    assert asked == [[(first, second), (others[0],), (others[1],)], [(first,), (second,)], [(second,)]]


def test_a_stop_keeps_what_was_made_and_adds_up_its_seconds(
    kit: Kit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(*given: object) -> None:
        raise KeyboardInterrupt

    engine, views = kit.engine(), kit.views()
    with monkeypatch.context() as patch:
        patch.setattr("rauca_core.study.makers.run_blender", stopped)
        with pytest.raises(KeyboardInterrupt):
            engine.make(views)
    folder = engine.store.place(views)
    artifact, seconds = read_recipe(folder)
    assert (artifact.digest, artifact.settings, seconds > 0) == (views.digest, views.settings, True)
    assert not (folder / LOCK).exists()
    recipe = json.loads((folder / RECIPE).read_text())
    (folder / RECIPE).write_text(json.dumps(recipe | {"seconds": 50.0}))
    engine.make(views)
    assert read_recipe(folder)[1] > 50.0
    assert engine.seconds["rendering views, views"] > 50.0


def test_another_process_is_waited_for(kit: Kit, tmp_path: Path) -> None:
    told: list[Progress] = []
    engine = Engine(Store(tmp_path / "store"), on_progress=lambda title, progress: told.append(progress))
    folder = engine.store.place(kit.views())
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        with alone_in(folder, LOCK):
            os.write(write, b".")
            os.close(write)
            while not (tmp_path / "seen").exists():
                pass
        os._exit(0)
    os.read(read, 1)
    engine.on_progress = lambda title, progress: (told.append(progress), (tmp_path / "seen").touch())
    engine.make(kit.views())
    os.waitpid(child, 0)
    assert f"process {child} on" in told[0].last
    assert kit.blender.frames["make_dataset"] == 4


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights of a detector of two layers."""
    cfg = tmp_path_factory.mktemp("tiny") / "tiny.cfg"
    cfg.write_text(cfg_of(TINY))
    cfg.with_suffix(".names").write_text("boat\ncar\n")
    return write_random_weights(cfg.with_suffix(".weights"), cfg)


def detected(images: Artifact, tiny: Path, frames: Sequence[str]) -> Artifact:
    return recipes.detections(images, load_detector(str(tiny)), str(tiny), DetectionSettings(), frames)


def test_images_are_defended_and_seen_once(kit: Kit, tmp_path: Path, tiny: Path) -> None:
    engine = kit.engine()
    renders = kit.painted(engine)
    frames = renders.options["frames"]
    bits = recipes.defended(renders, make_defence("bits"), frames)
    wanted = [detected(images, tiny, frames) for images in (kit.views(), renders, bits)]
    folders = engine.make(*wanted)
    assert engine.made["detections"] == 3
    (defended,), (rendered,) = engine.make(bits), engine.make(renders)
    for image in defended.glob("*.png"):
        shown = torch.from_numpy(read_image(rendered / image.name).transpose(2, 0, 1).copy())[None].float() / 255
        expected = (make_defence("bits")(shown)[0] * 255).round().permute(1, 2, 0)
        assert (read_image(image) == expected.numpy()).all()
    lines = {folder: next(folder.glob("*.jsonl")).read_bytes() for folder in folders}
    assert all(len(found.splitlines()) == 4 for found in lines.values())
    again = kit.engine()
    assert (again.make(*wanted), again.made) == (folders, {})
    next(folders[1].glob("*.jsonl")).write_bytes(lines[folders[1]][:-40])
    again = kit.engine()
    again.make(*wanted)
    assert again.made == {"detections": 1}
    assert sorted(next(folders[1].glob("*.jsonl")).read_bytes().splitlines()) == sorted(lines[folders[1]].splitlines())


def test_an_optimization_goes_on_where_it_stopped(kit: Kit, tmp_path: Path) -> None:
    detector = SmallDetector()
    settings = make_settings(steps=3, batch=1, map_size=32, samples=1, checkpoint_every=1, threads=1)
    training = recipes.data_set("train", kit.plan, kit.vehicle, kit.views().options["frames"], exact=True)
    paint = recipes.paint(training, settings, [("small", detector)])
    machine = Machine(threads=1, loaded={detector.fingerprint: detector})

    def stop(title: str, progress: Progress) -> None:
        if title.startswith("optimizing") and progress.done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Engine(Store(tmp_path / "stopped"), machine, stop).make(paint)
    (gone_on,) = Engine(Store(tmp_path / "stopped"), machine).make(paint)
    (at_once,) = Engine(Store(tmp_path / "at-once"), machine).make(paint)
    for name in ("camouflage.png", "camouflage.json"):
        assert (gone_on / name).read_bytes() == (at_once / name).read_bytes()
    for other in (settings.model_copy(update={"steps": 4}), settings.model_copy(update={"lr": 0.5})):
        assert recipes.paint(training, other, [("small", detector)]).digest != paint.digest
    for same in (settings.model_copy(update={"threads": 2}), settings.model_copy(update={"name": "other"})):
        assert recipes.paint(training, same, [("small", detector)]).digest == paint.digest


def test_a_part_of_a_data_set_is_linked(kit: Kit, tmp_path: Path) -> None:
    engine, whole = kit.engine(), kit.views()
    frames = whole.options["frames"][1:3]
    part, folder = engine.make(recipes.part_of(whole, "part", frames), whole)
    assert [frame.id for frame in Dataset(part).frames()] == frames
    image = f"frames/{frames[0]}/image.png"
    assert (part / image).samefile(folder / image)


def test_workers_of_a_cluster_make_the_same(kit: Kit, tmp_path: Path, tiny: Path) -> None:
    pytest.importorskip("submitit", reason="submitit is not installed")
    here = Engine(Store(tmp_path / "here"), Machine(threads=1))
    renders = kit.painted(here)
    frames = renders.options["frames"]
    here.make(renders)
    wanted = [detected(images, tiny, frames) for images in (kit.views(), renders)]
    there = Engine(
        Store(tmp_path / "there", [tmp_path / "here"]), Machine(threads=1), executor=OnCluster(Cluster("local"))
    )
    made_there = there.make(*wanted)
    for one, other in zip(here.make(*wanted), made_there, strict=True):
        assert other.is_relative_to(tmp_path / "there")
        assert next(other.glob("*.jsonl")).read_bytes() == next(one.glob("*.jsonl")).read_bytes()
        assert read_recipe(other)[1] > 0
    (tmp_path / "gone.weights").write_bytes(tiny.read_bytes())
    for suffix in (".cfg", ".names"):
        (tmp_path / "gone").with_suffix(suffix).write_bytes(tiny.with_suffix(suffix).read_bytes())
    lost = recipes.detections(
        renders, load_detector(str(tmp_path / "gone.weights")), str(tmp_path / "gone.weights"),
        DetectionSettings(score_threshold=0.3), frames,
    )  # fmt: skip
    (tmp_path / "gone.weights").unlink()
    with pytest.raises(RaucaError, match=r"detecting, gone-random-1: .*gone.weights: not found"):
        there.make(lost)


def test_the_cache_is_listed_and_pruned(kit: Kit, tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    engine = Engine(Store(cache))
    (renders,) = engine.make(kit.painted(engine))
    (cache / "weights").mkdir()
    (cache / "weights" / "net.weights").write_bytes(bytes(100))
    old = next((cache / "views").iterdir())
    os.utime(old / RECIPE, (1, 1))
    assert kept_in(cache)[0].path == old
    assert {one.kind for one in kept_in(cache)} == {"views", "random", "renders", "weights"}
    assert [one.path for one in prune(cache, older_than_s=3600)] == [old]
    least = sum(one.size for one in kept_in(cache) if one.kind != "weights")
    assert len(prune(cache, max_bytes=least - 1)) == 1
    prune(cache)
    assert [one.kind for one in kept_in(cache)] == ["weights"]
    prune(cache, kind="weights")
    assert not kept_in(cache)
    assert not renders.exists()


def test_a_changed_camouflage_is_another_artifact(tmp_path: Path, box_vehicle: Vehicle) -> None:
    path = tmp_path / "mine.json"
    random_camouflage(path, box_vehicle, 64, seed=1)
    before = recipes.camouflage_in(path, "mine")
    assert recipes.camouflage_in(path, "other").digest == before.digest
    random_camouflage(path, box_vehicle, 64, seed=2)
    assert recipes.camouflage_in(path, "mine").digest != before.digest


def test_an_evaluation_without_a_folder_is_kept_for_the_next(
    kit: Kit, tmp_path: Path, box_vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch, tiny: Path
) -> None:
    """As from a notebook: paint in memory, a loaded detector, no folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    box_vehicle.save(tmp_path / "box")
    random_camouflage(tmp_path / "mine.json", box_vehicle, 64, seed=1)
    paint = replace(load_paint(tmp_path / "mine.json"), path=None)
    asked = {"vehicle": str(tmp_path / "box"), "weathers": "single", "frames": 3}
    detector = load_detector(str(tiny))
    study = evaluate(paint, detector, **asked)
    rows = study.table()
    rows = rows if isinstance(rows, list) else rows.to_dict("records")
    assert {(row["paint"], row["detector"]) for row in rows} >= {("normal", "tiny"), (paint.name, "tiny")}
    before = dict(kit.blender.frames)
    assert evaluate([paint], [detector], **asked).entries[0].results == study.entries[0].results
    evaluate(paint, detector, out=tmp_path / "elsewhere", **asked)
    assert dict(kit.blender.frames) == before
    assert not (tmp_path / "elsewhere" / "store").exists()
