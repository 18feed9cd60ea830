"""Camouflages and vehicles of a study, and every mistake that is told before anything is rendered."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.stability.drawn import make_dataset
from pipelines.ablate_workspace import Workspace
from pipelines.protocol import Request, _held_out
from rauca_core.contract import Camouflage, MakeDataset, Plan, Quality, RaucaError, Vehicle, Weather, load_camouflage
from rauca_core.contract.camouflage import save_camouflage
from rauca_core.contract.files import png_bytes, write_bytes, write_json
from rauca_core.study.ablations.sizes import QUICK
from rauca_core.study.contestants import find_vehicles, keep_copy, match, read_contestants, read_vehicle_choice
from rauca_core.study.renders import FILE_NAME, RenderRecord
from rauca_core.study.views import RING
from tests.hostile.nasty import DEEP


def camouflage(folder: Path, name: str = "rauca", atlas: str = "a1", grey: int = 90, size: int = 8) -> Path:
    path = folder / f"{name}.json"
    pixels = np.full((size, size, 3), grey, np.uint8)
    save_camouflage(path, Camouflage(name, "box", atlas, 8, "plain"), png_bytes(pixels))
    return path


def test_labels_come_from_the_file_or_the_user(tmp_path: Path) -> None:
    one, two = camouflage(tmp_path / "a"), camouflage(tmp_path / "b", grey=10)
    found = read_contestants([str(one.with_suffix(".png")), f"night={two}"])
    assert [(c.label, c.path) for c in found] == [("rauca", one), ("night", two)]
    other_vehicle = camouflage(tmp_path / "c", atlas="b2")
    assert [c.label for c in read_contestants([str(one), str(other_vehicle)])] == ["rauca", "rauca"]


@pytest.mark.parametrize(
    ("name", "label", "complaint"),
    [
        ("normal", "", "cannot be called 'normal' in a study; name it: LABEL="),
        ("rauca", "Normal", "cannot be called 'Normal'"),
        ("rauca", "../up", "cannot be called '../up'"),
        ("rauca", "a/b", "cannot be called 'a/b'"),
        ("first", "", "called 'first' as .*first.json is; name one: LABEL="),
    ],
)
def test_labels_that_cannot_be_used_are_refused(tmp_path: Path, name: str, label: str, complaint: str) -> None:
    first, second = camouflage(tmp_path / "a", "first"), camouflage(tmp_path / "b", name)
    with pytest.raises(RaucaError, match=complaint):
        read_contestants([str(first), f"{label}={second}" if label else str(second)])


def test_broken_maps_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match=r"none.json: not found"):
        read_contestants([str(tmp_path / "none.json")])
    with pytest.raises(RaucaError, match=r"rauca.png: is 16x16, its .json says 8x8"):
        read_contestants([str(camouflage(tmp_path, size=16))])
    path = camouflage(tmp_path)
    path.with_suffix(".png").write_bytes(path.with_suffix(".png").read_bytes()[:40])
    with pytest.raises(RaucaError, match=r"rauca.png: not a readable image"):
        read_contestants([str(path)])


def test_vehicles_are_found_by_atlas(tmp_path: Path, box_vehicle: Vehicle) -> None:
    box_vehicle.save(tmp_path / "vehicle")
    vehicles = find_vehicles(["sedan", str(tmp_path / "vehicle")])
    assert [(v.name, v.category) for v in vehicles] == [("sedan", "car"), ("box", "car")]
    assert {"boat", "airplane", "car"} <= {v.category for v in find_vehicles([])}
    contestants = read_contestants([str(camouflage(tmp_path, atlas=box_vehicle.atlas_id))])
    assert match(contestants, vehicles, everyone=False) == {vehicles[1]: contestants}
    assert match(contestants, vehicles, everyone=True) == {vehicles[0]: [], vehicles[1]: contestants}
    with pytest.raises(RaucaError, match=r"made for UV atlas .* of box, there are sedan .* give its vehicle folder"):
        match(contestants, vehicles[:1], everyone=False)
    with pytest.raises(RaucaError, match=r"--vehicle tank: no vehicle folder"):
        find_vehicles(["tank"])


@pytest.fixture
def begun(tmp_path: Path, box_vehicle: Vehicle, monkeypatch: pytest.MonkeyPatch) -> tuple[Request, Workspace]:
    """A study and an ablation's workspace that hold views of the vehicle in ``car``."""
    box_vehicle.save(tmp_path / "car")
    choice = read_vehicle_choice(tmp_path / "car")

    def drawn(job: MakeDataset, *_: object) -> None:
        make_dataset(job.out, box_vehicle, 64, (40.0,))

    for module in ("protocol", "ablate_workspace"):
        monkeypatch.setattr(f"pipelines.{module}.run_blender", drawn)
    request, workspace = Request("", tmp_path / "study", {}, {}, (), ()), Workspace(tmp_path / "data", choice, QUICK)
    _held_out(request, choice, "single")
    workspace.views("single")
    return request, workspace


def test_another_vehicle_of_the_same_name_and_atlas_is_refused(
    begun: tuple[Request, Workspace], tmp_path: Path, box_vehicle: Vehicle
) -> None:
    request, workspace = begun
    paint, *others = box_vehicle.materials
    for other in (
        replace(box_vehicle, positions=box_vehicle.positions * np.float32(0.6)),
        replace(box_vehicle, normals=-box_vehicle.normals),
        replace(box_vehicle, materials=[replace(paint, roughness=0.9), *others]),
        replace(box_vehicle, base_texture=np.zeros((8, 8, 3), np.uint8)),
        replace(box_vehicle, notes=["imported again"]),
    ):
        other.save(tmp_path / "car")
        choice = read_vehicle_choice(tmp_path / "car")
        assert choice == workspace.vehicle
        if other.notes:
            _held_out(request, choice, "single")
            workspace.views("single")
            continue
        with pytest.raises(RaucaError, match=r"views: holds another vehicle of the name box .*; choose another --out"):
            _held_out(request, choice, "single")
        with pytest.raises(RaucaError, match=r"holds another vehicle of the name box .*; choose another --data"):
            workspace.views("single")


def test_what_was_rendered_does_not_need_its_copy_of_the_vehicle(begun: tuple[Request, Workspace]) -> None:
    request, workspace = begun
    views = _held_out(request, workspace.vehicle, "single").source
    (views / "vehicle" / "mesh.npz").write_bytes(b"cut")
    assert _held_out(request, workspace.vehicle, "single").source == views


def test_copies_follow_their_original(tmp_path: Path) -> None:
    path = camouflage(tmp_path)
    (contestant,) = read_contestants([f"mine={path}"])
    copy = keep_copy(contestant, tmp_path / "study")
    assert load_camouflage(copy)[0].name == "mine"
    stamp = copy.stat().st_mtime_ns
    assert keep_copy(contestant, tmp_path / "study").stat().st_mtime_ns == stamp
    camouflage(tmp_path, grey=200)
    keep_copy(contestant, tmp_path / "study")
    assert copy.with_suffix(".png").read_bytes() == path.with_suffix(".png").read_bytes()


def test_renders_are_known_by_plan_map_and_image(tmp_path: Path) -> None:
    """Whatever changes, the folder no longer holds what is needed."""
    plan = Plan("v", "box", "a1", 32, Quality(1), False, (Weather("w", 40),), RING, 1, (1, 2, 3), 0.5, 0, "5.0")
    path, renders = camouflage(tmp_path), tmp_path / "renders"
    record = RenderRecord.of(plan, [path])
    assert not record.holds(renders, ["f"])
    write_bytes(renders / "rauca" / "f.png", b"png")
    record.save(renders)
    assert record.holds(renders, ["f"])
    assert RenderRecord.of(Plan(**{**plan.__dict__, "blender": "4.5"}), [path]).holds(renders, ["f"])
    assert not record.holds(renders, ["f", "g"])
    assert not RenderRecord.of(Plan(**{**plan.__dict__, "seed": 1}), [path]).holds(renders, ["f"])
    camouflage(tmp_path, grey=7)
    assert not RenderRecord.of(plan, [path]).holds(renders, ["f"])
    for damaged in ({"plan": record.plan}, {"plan": record.plan, "uv_maps": 3}, {**record.__dict__, "plan": None}):
        write_json(renders / FILE_NAME, damaged)
        assert not record.holds(renders, ["f"])
    write_bytes(renders / FILE_NAME, DEEP)
    assert not record.holds(renders, ["f"])
    record.forget(renders)
    assert not record.holds(renders, ["f"])
