"""The procedural sedan: a sound mesh, a clean atlas, and the same as the one that is shipped."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.contract import load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.geometry import atlas_report
from rauca_core.geometry.build import main
from rauca_core.geometry.mesh import face_normals
from rauca_core.images import read_image

SHIPPED = assets_folder() / "vehicles" / "sedan"


def test_shipped_sedan_is_the_built_one(sedan):
    shipped = load_vehicle(SHIPPED, read_image)
    assert shipped.materials == sedan.materials
    assert np.array_equal(shipped.triangles, sedan.triangles)
    assert np.array_equal(shipped.material, sedan.material)
    assert np.allclose(shipped.positions, sedan.positions, atol=1e-6)
    assert np.allclose(shipped.normals, sedan.normals, atol=1e-4)
    assert np.allclose(shipped.uvs, sedan.uvs, atol=1e-4)
    assert (shipped.paint_mask != sedan.paint_mask).mean() < 1e-4
    assert sum(p.stat().st_size for p in SHIPPED.iterdir()) < 2 * 2**20


def test_mesh_is_sound(sedan):
    _, area = face_normals(sedan.positions, sedan.triangles)
    assert np.isfinite(sedan.positions).all()
    assert area.min() > 1e-8
    assert np.allclose(np.linalg.norm(sedan.normals, axis=2), 1.0, atol=1e-5)
    assert len(sedan.triangles) <= 40_000
    assert len({m.name for m in sedan.materials}) == len(sedan.materials)
    assert set(np.unique(sedan.material)) == set(range(len(sedan.materials)))


def test_frame_and_size_are_a_cars(sedan):
    length, width, height = sedan.size()
    assert 4.4 < length < 4.9
    assert 1.9 < width < 2.3  # with mirrors
    assert 1.35 < height < 1.55
    low, high = sedan.positions.min(axis=0), sedan.positions.max(axis=0)
    assert low[2] == 0.0
    assert np.allclose(low[:2] + high[:2], 0.0, atol=1e-3)


def centre_of(sedan, name: str) -> np.ndarray:
    index = [m.name for m in sedan.materials].index(name)
    return sedan.positions[sedan.triangles[sedan.material == index]].reshape(-1, 3).mean(axis=0)


def test_front_is_where_the_headlamps_are(sedan):
    assert centre_of(sedan, "headlamp")[0] > 1.9
    assert centre_of(sedan, "taillamp")[0] < -1.9
    assert abs(centre_of(sedan, "headlamp")[1]) < 1e-2


def test_tyres_enclose_a_positive_volume(sedan):
    index = [m.name for m in sedan.materials].index("tyre")
    corners = sedan.positions[sedan.triangles[sedan.material == index]].astype(np.float64)
    hub = np.round(corners.mean(axis=1) / [1.39, 0.795, 0.33]) * [1.39, 0.795, 0.33]
    corners -= hub[:, None]
    assert np.einsum("ni,ni->n", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() > 0


@pytest.mark.parametrize("name", ["paint", "glass", "headlamp", "taillamp"])
def test_faces_look_outwards(sedan, name):
    """Shading normals agree with the winding, and a skin's windings point away from the car's spine."""
    normals, area = face_normals(sedan.positions, sedan.triangles)
    index = [m.name for m in sedan.materials].index(name)
    here = sedan.material == index
    assert ((normals[here, None] * sedan.normals[here]).sum(axis=2) > 0).mean() > 0.999
    middle = sedan.positions[sedan.triangles[here]].mean(axis=1)
    spine = np.stack([np.clip(middle[:, 0], -1.6, 1.6), 0 * middle[:, 1], np.full(len(middle), 0.6)], axis=1)
    on_body = np.abs(middle[:, 1]) < 0.93  # mirrors have an inner side too
    outwards = ((middle - spine) * normals[here]).sum(axis=1) > 0
    assert np.average(outwards[on_body], weights=area[here][on_body]) > 0.995


def test_left_and_right_mirror_each_other(sedan):
    ink = [m.name for m in sedan.materials].index("ink")  # the plates' characters do not mirror
    faces = sedan.triangles[sedan.material != ink]
    points = {tuple(p) for p in np.round(sedan.positions[faces].reshape(-1, 3) * 2**16).astype(int).tolist()}
    assert all((x, -y, z) in points for x, y, z in points)


def test_atlas_is_clean(sedan):
    report = atlas_report(sedan)
    assert len(sedan.paint_mask) == 1024
    assert (report.overlap, report.out_of_range, report.degenerate) == (0.0, 0, 0)
    assert report.charts < 60
    assert report.worst_spread <= 0.05
    assert report.density_of_charts < 0.005
    assert report.padding_texels >= 4
    assert report.border_texels >= 4
    assert report.padding_texels >= sedan.padding_texels
    assert report.utilisation > 0.55


def test_lamps_are_dark_by_day(sedan):
    assert all(m.emission == 0.0 for m in sedan.materials)


def test_build_command_names_its_vehicles(capsys):
    assert main(["bus"]) == 2
    assert "sedan" in capsys.readouterr().err
