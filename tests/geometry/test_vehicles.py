"""Every procedural vehicle: the same as the one that is shipped, sound, on its feet, and cleanly unwrapped."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest

from rauca_core.contract import load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.geometry import covered
from rauca_core.geometry.build import BUILDERS, main
from rauca_core.geometry.mesh import face_normals
from rauca_core.runtime.images import read_image
from tests.atlas_report import atlas_report

# Category; length, width (a car's with mirrors) and height in metres: low, high.
KINDS = {
    "sedan": ("car", (4.4, 4.9), (1.9, 2.3), (1.35, 1.55)),
    "hatchback": ("car", (3.8, 4.4), (1.9, 2.3), (1.35, 1.55)),
    "suv": ("car", (4.3, 4.9), (2.0, 2.4), (1.60, 1.80)),
    "van": ("car", (4.6, 5.4), (2.0, 2.5), (1.85, 2.10)),
    **dict.fromkeys(("cylinder", "cube", "sphere"), ("shape", (2.9, 4.1), (1.7, 3.1), (1.7, 3.1))),
    **dict.fromkeys(("boat", "boat_detailed"), ("boat", (5.0, 6.6), (1.9, 2.5), (1.8, 3.7))),
    "aeroplane": ("airplane", (8.0, 10.0), (8.5, 9.5), (3.0, 4.0)),
}


@pytest.fixture(params=BUILDERS)
def vehicle(request, build):
    return build(request.param)


@pytest.mark.stored
def test_shipped_is_built_again(vehicle):
    """Its last digits are those of the machine that built it: `Vehicle.changed` looks at all but them."""
    folder = assets_folder() / "vehicles" / vehicle.name
    shipped = load_vehicle(folder, read_image)
    # xatlas's wheel for Python 3.13 lays out the same mesh otherwise than that for 3.11, three of the ten by more than
    # last digits. What is shipped is read, not built.
    may_change = {"uvs", "paint_mask"} if sys.version_info >= (3, 12) else set()
    assert set(shipped.changed(vehicle)) <= may_change
    assert (shipped.source, shipped.licence, shipped.notes) == (vehicle.source, vehicle.licence, vehicle.notes)
    assert sum(p.stat().st_size for p in folder.iterdir()) < 450 * 1024


@pytest.mark.stored
def test_an_identity_does_not_hold_the_processors_last_digits(vehicle):
    """What rounding leaves of a zero, and the sign of a zero, is another on another processor."""
    shipped = load_vehicle(assets_folder() / "vehicles" / vehicle.name, read_image)
    left = np.where(np.arange(shipped.normals.size).reshape(shipped.normals.shape) % 2, -3e-17, 2e-18)
    normals = np.where(shipped.normals == 0, left, shipped.normals).astype(np.float32)
    assert normals.tobytes() != shipped.normals.tobytes()
    signed = np.where(shipped.positions == 0, np.float32(-0.0), shipped.positions)
    assert replace(shipped, normals=normals, positions=signed).geometry_id == shipped.geometry_id
    bent = replace(shipped, normals=shipped.normals[:, ::-1])
    assert bent.geometry_id != shipped.geometry_id or vehicle.name == "cube"


def test_the_shipped_sedan_is_the_one_camouflages_were_made_for():
    assert load_vehicle(assets_folder() / "vehicles" / "sedan", read_image).atlas_id == "60637f9178cd6f92"


def test_mesh_is_sound(vehicle):
    normals, area = face_normals(vehicle.positions, vehicle.triangles)
    assert np.isfinite(vehicle.positions).all()
    assert area.min() > 1e-8
    assert np.allclose(np.linalg.norm(vehicle.normals, axis=2), 1.0, atol=1e-5)
    assert ((normals[:, None] * vehicle.normals).sum(axis=2) > 0).mean() > 0.999
    assert len(vehicle.triangles) <= 25_000
    assert len({m.name for m in vehicle.materials}) == len(vehicle.materials)
    assert set(np.unique(vehicle.material)) == set(range(len(vehicle.materials)))


def test_category_size_and_place(vehicle):
    category, *sizes = KINDS[vehicle.name]
    assert vehicle.category == category
    for extent, (low, high) in zip(vehicle.size(), sizes, strict=True):
        assert low < extent < high
    low, high = vehicle.positions.min(axis=0), vehicle.positions.max(axis=0)
    assert low[2] == 0.0
    assert np.allclose(low[:2] + high[:2], 0.0, atol=1e-3)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1, 1])
def test_whoever_looks_at_paint_sees_its_outer_side(vehicle, axis, sign):
    """Look along an axis, from infinity: of the faces nearest to the eye, painted ones turn their front to it."""
    seen = nearest_faces(vehicle, axis, sign)
    normals, _ = face_normals(vehicle.positions, vehicle.triangles)
    front = normals[seen, axis] * sign > 0
    painted = vehicle.paint_faces()[seen]
    assert painted.sum() > 300 or (axis, sign) == (2, -1)  # from below there may be little paint, or none
    assert (painted & ~front).sum() <= 0.005 * painted.sum()


def nearest_faces(vehicle, axis: int, sign: int, size: int = 128) -> np.ndarray:
    """The face seen in each filled pixel of an orthographic picture from ``sign`` times ``axis``."""
    corners = vehicle.positions[vehicle.triangles].astype(np.float64)
    flat = np.delete(corners, axis, axis=2)
    low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    pixels, faces = covered((flat - low) / (high - low).max(), size, conservative=False)
    nearness = sign * corners[faces][..., axis].mean(axis=1)
    order = np.lexsort((-nearness, pixels))
    _, first = np.unique(pixels[order], return_index=True)
    return faces[order[first]]


def test_front_is_ahead(build):
    for name in ("boat", "boat_detailed"):
        points, (length, width, _) = build(name).positions, build(name).size()
        bow, stern = points[points[:, 0] > 0.42 * length], points[points[:, 0] < -0.36 * length]
        assert np.abs(bow[:, 1]).max() < 0.3 * width < 0.4 * width < np.abs(stern[:, 1]).max()
    aeroplane = build("aeroplane")
    assert aeroplane.positions[aeroplane.positions[:, 2].argmax(), 0] < -3.0  # the fin's tip


def test_atlas_is_clean(vehicle):
    report = atlas_report(vehicle)
    assert len(vehicle.paint_mask) == 1024
    assert (report.overlap, report.out_of_range, report.degenerate) == (0.0, 0, 0)
    assert report.charts < 100
    assert report.worst_spread <= 0.05
    assert report.density_of_charts < 0.005
    assert report.border_texels >= 4
    assert report.padding_texels >= vehicle.padding_texels >= 4
    assert report.utilisation > 0.5


@pytest.mark.stored
def test_build_command_writes_what_is_shipped(tmp_path, capsys):
    for folder in ("one", "two"):
        assert main(["boat", str(tmp_path / folder)]) == 0
    one, two, shipped = tmp_path / "one/boat", tmp_path / "two/boat", assets_folder() / "vehicles" / "boat"
    assert {file.name for file in one.iterdir()} == {file.name for file in shipped.iterdir()}
    assert all(file.read_bytes() == (two / file.name).read_bytes() for file in one.iterdir())
    made = load_vehicle(one, read_image)
    assert not ((np.abs(made.normals) < 1e-9) & (made.normals != 0)).any()
    assert "m" in capsys.readouterr().out


def test_build_command_names_its_vehicles(capsys):
    assert main(["bus"]) == 2
    message = capsys.readouterr().err
    assert all(name in message for name in (*BUILDERS, "all"))
