"""``rauca ablate`` at thumbnail size: real Blender, real detector, real optimizer; and what it keeps when it stops."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipelines.ablate import Ablation, Repeat, _optimize, run_ablation
from pipelines.ablate_clock import Clock
from pipelines.ablate_workspace import Workspace, alone, linked_part, pour
from pipelines.cli import app
from pipelines.demo import run_demo
from pipelines.going_on import goes_on_by_itself
from pipelines.tradeoff import run_tradeoff
from rauca_core.attack import random_camouflage
from rauca_core.contract import Dataset, RaucaError, StoppedError, load_camouflage, load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.detect import load_detector
from rauca_core.detect.load import resolve
from rauca_core.runtime.images import read_image
from rauca_core.study.ablations.sizes import QUICK
from rauca_core.study.contestants import Contestant, find_vehicles, keep_copy
from rauca_core.study.study import load_study
from tests.published import published_weights


def ablate(*arguments: object) -> str:
    return CliRunner().invoke(app, ["ablate", *map(str, arguments)], catch_exceptions=False).output


@pytest.fixture(scope="module")
def _weights() -> None:
    published_weights("yolov3-tiny")


def written(folder: Path) -> dict[str, int]:
    """Every file that took work, and when it was written."""
    kinds = (".png", ".npz", ".safetensors")
    return {str(p.relative_to(folder)): p.stat().st_mtime_ns for p in folder.rglob("*") if p.suffix in kinds}


@pytest.mark.usefixtures("_weights")
def test_an_ablation_from_views_to_verdicts_and_again(tmp_path: Path) -> None:
    pytest.importorskip("bpy", reason="the bpy wheel is not installed")
    out, data = tmp_path / "views", tmp_path / "data"
    asked = ["views", "--quick", "--out", out, "--frames", 8, "--held-out", 2, "--size", 64, "--samples", 1]
    asked += ["--steps", 2, "--batch", 2, "--map-size", 64, "--detectors", "yolov3-tiny", "--threads", 1]
    asked += ["--resamples", 20]
    ablate(*asked)
    (entry,) = load_study(out).entries
    assert entry.results.paints == ("normal", "random", "share-08th", "all")
    whole, part = sorted((p for p in (data / "sets").iterdir() if p.is_dir()), key=lambda p: len(p.name))
    assert {f.id for f in Dataset(part).frames()} < {f.id for f in Dataset(whole).frames()}
    found = json.loads((out / "ablation.json").read_text())
    assert [v["by"] for v in found["verdicts"]] == ["this project"]  # of the variants of the quick size
    assert "All views below 1/8 of the views" in (out / "ablation.html").read_text()

    before = written(data)
    (out / "ablation.html").unlink()
    ablate(*asked)
    assert (out / "ablation.html").is_file()
    assert written(data) == before  # nothing was made twice

    lost = next(data.glob("renders/*/all-*/*.png"))
    lost.unlink()
    ablate(*asked)
    again = written(data)
    assert {name for name in again if again[name] != before[name]} == {str(lost.relative_to(data))}


@pytest.mark.usefixtures("_weights")
def test_mistakes_are_told_before_anything_is_made(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    double = shutil.copy(assets_folder() / "weathers" / "unseen.json", tmp_path_factory.mktemp("own") / "seen.json")
    for asked, told in (
        (("nothing",), "ablation: no 'nothing'; choose one of baselines"),
        (("beta", "--variants", "beta-0,x"), "beta: no variant 'x'; choose of beta-100"),
        (("beta", "--weathers", "hail"), "weather preset 'hail' is unknown"),
        (("beta", "--weathers", f"seen,{double}"), "seen.json: has the name of seen"),
        (("beta", "--vehicle", "tank"), "--vehicle tank: no vehicle folder"),
        (("beta", "--attack", "nobody"), "nobody"),
        (("beta", "--detectors", "yolov3-tiny", "--lr", 5), "lr: input should be less than or equal to 1, not 5.0"),
        (("beta", "--detectors", "yolov3-tiny", "--map-size", 100_000), "map_size: .*not 100000"),
        (("beta", "--detectors", "yolov3-tiny", "--threads", 0), "threads: .*not 0"),
    ):
        with pytest.raises(RaucaError, match=told):
            ablate(*asked, "--out", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_weights_of_ones_own_are_attacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (stock,) = (load_detector(name) for name in published_weights("yolov3-tiny"))
    mine = tmp_path / "mine.weights"
    content = bytearray(resolve("yolov3-tiny").files[0].read_bytes())
    content[-4000:] = bytes(4000)
    mine.write_bytes(content)
    typed, seen = f"yolov3-tiny={mine}", []

    def look(asked: Ablation) -> Path:
        monkeypatch.setattr(asked.workspace, "training", lambda *_: tmp_path)
        monkeypatch.setattr(asked.workspace, "run", lambda name, key, work: (seen.append(key), work(tmp_path, False)))
        _optimize(asked, Repeat(asked.variants[0], 0, "x"))
        return tmp_path

    monkeypatch.setattr("pipelines.ablate.run_ablation", look)
    monkeypatch.setattr("pipelines.optimize_camouflage.optimize", lambda data, loaded, *_: seen.append(loaded))
    monkeypatch.setattr("pipelines.optimize_camouflage.Dataset", Path)
    ablate("beta", "--quick", "--out", tmp_path / "out", "--attack", typed)
    key, (attacked,) = seen
    assert key["detectors"] == [attacked.fingerprint]
    assert attacked.fingerprint != stock.fingerprint


def test_detections_are_poured_once(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    one.mkdir()
    (one / "d.jsonl").write_text("a\nb\n")
    pour(one, two)
    (one / "d.jsonl").write_text("b\nc\n")
    pour(one, two)
    pour(tmp_path / "nowhere", two)
    assert (two / "d.jsonl").read_text() == "a\nb\nc\n"


def test_what_two_ablations_call_otherwise_is_made_once(tmp_path: Path) -> None:
    (sedan,) = find_vehicles(["sedan"])
    workspace, made = Workspace(tmp_path / "data", sedan, QUICK), []

    def work(folder: Path, resume: bool) -> None:
        made.append((folder.name.rsplit("-", 1)[0], resume))
        random_camouflage(folder / "camouflage.json", load_vehicle(sedan.folder, read_image), 64)

    one = workspace.run("with-roa", {"steps": 4}, work)
    assert workspace.run("e2e-taps", {"steps": 4}, work) == one
    other = workspace.run("e2e-taps", {"steps": 5}, work)
    assert made == [("with-roa", False), ("e2e-taps", False)]

    kept = workspace.paint(one)
    assert kept.name.startswith("random-")
    renamed = keep_copy(Contestant("another name", other, load_camouflage(other)[0]), tmp_path)
    assert workspace.paint(renamed) == kept  # the same map
    kept.with_suffix(".png").write_bytes(b"damaged")
    assert load_camouflage(workspace.paint(renamed))[1].read_bytes() == one.with_suffix(".png").read_bytes()


def test_a_part_of_a_data_set_is_linked_and_whole(tmp_path: Path) -> None:
    whole = tmp_path / "set"
    for name in ("vehicle/mesh.npz", "frames/a/image.png", "frames/b/image.png"):
        (whole / name).parent.mkdir(parents=True, exist_ok=True)
        (whole / name).write_bytes(name.encode())
    (whole / "dataset.json").write_text("{}")
    part = linked_part(whole, ["a", "hidden"])
    assert sorted(p.relative_to(part).as_posix() for p in part.rglob("*") if p.is_file()) == [
        "dataset.json",
        "frames/a/image.png",
        "vehicle/mesh.npz",
    ]
    assert (part / "frames/a/image.png").samefile(whole / "frames/a/image.png")
    assert linked_part(whole, ["a", "hidden"]) == part


def test_a_product_is_made_by_one_at_a_time(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    with alone(tmp_path / "set"), (tmp_path / ".set.lock").open("w") as other, pytest.raises(BlockingIOError):
        fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with alone(tmp_path / "set"):
        pass  # free again


def test_the_clock_adds_up_what_was_interrupted(tmp_path: Path) -> None:
    path = tmp_path / "timings.json"
    path.write_text('{"a": 5.0}')
    clock = Clock(path)
    with pytest.raises(ZeroDivisionError), clock.time("a"):
        _ = 1 / 0
    with clock.time("b"):
        pass
    assert clock.seconds["a"] >= 5.0
    assert set(Clock(path).seconds) == {"a", "b"}
    for damaged in ("{", "[]", '{"a": "x"}', "[" * 100_000):
        path.write_text(damaged)
        assert clock.seconds == {}


def test_a_stop_is_told_with_what_goes_on_here() -> None:
    @goes_on_by_itself()
    def work() -> None:
        raise StoppedError("out: stopped after step 4 of 8")

    with pytest.raises(RaucaError, match=r"^out: stopped after step 4 of 8; run the same command again to go on$"):
        work()
    assert all(hasattr(run, "__wrapped__") for run in (run_ablation, run_tradeoff, run_demo))
