"""Camouflages and vehicles of a study, and every mistake that is told before anything is rendered."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rauca_core.contract import Camouflage, RaucaError, Vehicle, load_camouflage
from rauca_core.contract.camouflage import save_camouflage
from rauca_core.contract.files import png_bytes
from rauca_core.study.candidates import find_vehicles, keep_copy, match, read_candidates


def camouflage(folder: Path, name: str = "rauca", atlas: str = "a1", grey: int = 90, size: int = 8) -> Path:
    path = folder / f"{name}.json"
    pixels = np.full((size, size, 3), grey, np.uint8)
    save_camouflage(path, Camouflage(name, "box", atlas, 8, "plain"), png_bytes(pixels))
    return path


def test_labels_come_from_the_file_or_the_user(tmp_path: Path) -> None:
    one, two = camouflage(tmp_path / "a"), camouflage(tmp_path / "b", grey=10)
    found = read_candidates([str(one.with_suffix(".png")), f"night={two}"])
    assert [(c.label, c.path) for c in found] == [("rauca", one), ("night", two)]
    other_vehicle = camouflage(tmp_path / "c", atlas="b2")
    assert [c.label for c in read_candidates([str(one), str(other_vehicle)])] == ["rauca", "rauca"]


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
        read_candidates([str(first), f"{label}={second}" if label else str(second)])


def test_broken_maps_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match=r"none.json: not found"):
        read_candidates([str(tmp_path / "none.json")])
    with pytest.raises(RaucaError, match=r"rauca.png: is 16x16, its .json says 8x8"):
        read_candidates([str(camouflage(tmp_path, size=16))])
    path = camouflage(tmp_path)
    path.with_suffix(".png").write_bytes(path.with_suffix(".png").read_bytes()[:40])
    with pytest.raises(RaucaError, match=r"rauca.png: not a readable image"):
        read_candidates([str(path)])


def test_vehicles_are_found_by_atlas(tmp_path: Path, box_vehicle: Vehicle) -> None:
    box_vehicle.save(tmp_path / "vehicle")
    vehicles = find_vehicles(["sedan", str(tmp_path / "vehicle")])
    assert [(v.name, v.category) for v in vehicles] == [("sedan", "car"), ("box", "car")]
    assert {"boat", "airplane", "car"} <= {v.category for v in find_vehicles([])}
    candidates = read_candidates([str(camouflage(tmp_path, atlas=box_vehicle.atlas_id))])
    assert match(candidates, vehicles, everyone=False) == {vehicles[1]: candidates}
    assert match(candidates, vehicles, everyone=True) == {vehicles[0]: [], vehicles[1]: candidates}
    with pytest.raises(RaucaError, match=r"made for UV atlas .* of box, there are sedan .* give its vehicle folder"):
        match(candidates, vehicles[:1], everyone=False)
    with pytest.raises(RaucaError, match=r"--vehicle tank: no vehicle folder"):
        find_vehicles(["tank"])


def test_copies_follow_their_original(tmp_path: Path) -> None:
    path = camouflage(tmp_path)
    copy = keep_copy("mine", path, tmp_path / "study")
    assert load_camouflage(copy)[0].name == "mine"
    stamp = copy.stat().st_mtime_ns
    assert keep_copy("mine", path, tmp_path / "study").stat().st_mtime_ns == stamp
    camouflage(tmp_path, grey=200)
    keep_copy("mine", path, tmp_path / "study")
    assert copy.with_suffix(".png").read_bytes() == path.with_suffix(".png").read_bytes()
