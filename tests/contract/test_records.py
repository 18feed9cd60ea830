"""Vehicles, frames, data sets, camouflages and weathers survive the disk, and damage is named."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rauca_core.contract import (
    Camouflage,
    Dataset,
    RaucaError,
    Ring,
    claim_folder,
    load_camouflage,
    load_frame,
    load_passes,
    load_vehicle,
    save_camouflage,
    save_frame,
)
from rauca_core.contract.color import linear_to_srgb, srgb_to_linear
from rauca_core.contract.files import png_bytes
from rauca_core.contract.seeding import named_rng, named_seed
from rauca_core.runtime.images import read_image

from .samples import PLAN, a_frame, some_passes


def test_vehicle_round_trip(tmp_path, box_vehicle):
    box_vehicle.save(tmp_path / "v")
    again = load_vehicle(tmp_path / "v", read_image)
    assert np.array_equal(again.uvs, box_vehicle.uvs)
    assert (again.atlas_id, again.geometry_id) == (box_vehicle.atlas_id, box_vehicle.geometry_id)
    assert again.materials == box_vehicle.materials


def test_a_vehicle_tells_in_what_another_differs_but_for_last_digits(tmp_path, box_vehicle):
    box_vehicle.save(tmp_path / "v")
    again = load_vehicle(tmp_path / "v", read_image)
    again.positions += np.float32(1e-6)
    again.materials[0] = replace(again.materials[0], roughness=again.materials[0].roughness + 1e-7)
    assert box_vehicle.changed(again) == []
    again.positions[:, 2] *= 1.5
    assert box_vehicle.changed(again) == ["positions"]
    again.materials[0] = replace(again.materials[0], roughness=0.9)
    again.base_texture = np.zeros((4, 4, 3), np.uint8)
    assert box_vehicle.changed(again) == ["positions", "base_texture", "materials"]
    again.triangles = again.triangles[:-1]
    assert "triangles" in again.changed(box_vehicle)


def test_a_texture_of_16_bits_is_the_same_whoever_made_8_of_them(box_vehicle):
    """Blender rounds, Pillow cuts."""
    sixteen = np.random.default_rng(0).integers(0, 2**16, (16, 16, 3))
    cut, rounded = (sixteen >> 8).astype(np.uint8), np.rint(sixteen / 257).astype(np.uint8)
    assert not np.array_equal(cut, rounded)
    given, kept = (replace(box_vehicle, base_texture=texture) for texture in (cut, rounded))
    assert kept.changed(given) == given.changed(kept) == []
    for other in (cut ^ 2, cut[:-1], None):
        assert kept.changed(replace(given, base_texture=other)) == ["base_texture"]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda v: v.positions.__setitem__((0, 0), np.nan), "1 of 8 vertices are NaN"),
        (lambda v: v.triangles.__setitem__((0, 0), 99), "vertex that does not exist"),
        (lambda v: v.paint_mask.fill(0), "paint mask is empty"),
        (lambda v: v.material.fill(1), "no face has a paint material"),
        (lambda v: v.uvs.__setitem__((0, 0, 0), np.inf), "UVs or normals"),
        (lambda v: setattr(v, "triangles", v.triangles[:0]), "no faces"),
    ],
)
def test_a_vehicle_that_cannot_be_painted_is_refused_and_not_written(tmp_path, box_vehicle, spoil, message):
    spoil(box_vehicle)
    with pytest.raises(RaucaError, match=message):
        box_vehicle.save(tmp_path / "v")
    assert not list(tmp_path.iterdir())


def test_a_changed_mesh_is_noticed(tmp_path, box_vehicle):
    box_vehicle.save(tmp_path / "v")
    (tmp_path / "v" / "paint_mask.png").write_bytes(png_bytes(np.full((64, 64), 255, np.uint8)))
    with pytest.raises(RaucaError, match="changed after"):
        load_vehicle(tmp_path / "v", read_image)
    (tmp_path / "v" / "mesh.npz").write_bytes(b"PK\x03\x04 not an archive")
    with pytest.raises(RaucaError, match=r"mesh\.npz: damaged"):
        load_vehicle(tmp_path / "v", read_image)


@pytest.mark.parametrize("box", [(1.0, 2.0, 30.0, 20.0), None])
def test_frame_round_trip(tmp_path, box):
    frame, passes = a_frame(box_xyxy=box), some_passes()
    save_frame(tmp_path / frame.id, frame, passes)
    again = load_frame(tmp_path / frame.id)
    assert (again.to_json(), again.box_xyxy) == (frame.to_json(), box)
    stored = load_passes(tmp_path / frame.id)
    assert np.allclose(stored["A"], passes.A, rtol=1e-3, atol=1e-3)
    assert np.isfinite(stored["B"]).all()  # light beyond float16's range is clipped, not infinite
    image = read_image(tmp_path / frame.id / "image.png")
    assert np.abs(image / 255 - linear_to_srgb(passes.image_linear)).max() <= 0.5 / 255 + 1e-6


def test_a_frame_without_light_has_no_light_maps(tmp_path):
    frame = a_frame()
    save_frame(tmp_path / frame.id, frame, some_passes(A=None, B=None))
    assert load_passes(tmp_path / frame.id, ("distance",))["distance"].shape == (32, 32)
    with pytest.raises(RaucaError, match=r"passes\.npz"):
        load_passes(tmp_path / frame.id)


def test_a_moved_frame_is_noticed(tmp_path):
    save_frame(tmp_path / "other", a_frame(), some_passes())
    with pytest.raises(RaucaError, match="folder is called 'other'"):
        load_frame(tmp_path / "other")


def test_the_plan_names_every_frame_once():
    ids = [frame.id for frame in PLAN.frames()]
    assert len(ids) == len(set(ids)) == 2 * 2 * 4
    assert {PLAN.ring.nominal(view) for view in range(4)} == {(a, e, 5.0) for a in (0, 90) for e in (10, 30)}


def test_a_folder_keeps_to_one_plan(tmp_path):
    claim_folder(tmp_path, PLAN)
    claim_folder(tmp_path, replace(PLAN, blender="4.5.0"))
    claim_folder(tmp_path, replace(PLAN, name="renamed"))
    assert Dataset(tmp_path).plan == PLAN
    with pytest.raises(RaucaError, match="another size, seed"):
        claim_folder(tmp_path, replace(PLAN, size=64, seed=8))


@pytest.mark.parametrize(("version", "remedy"), [(99, "update rauca"), (2, "make it again in another folder")])
def test_a_dataset_of_another_version_is_refused(tmp_path, version, remedy):
    claim_folder(tmp_path, PLAN)
    path = tmp_path / "dataset.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "version": version}))
    with pytest.raises(RaucaError, match=rf"dataset\.json: .*rauca-dataset version {version}.*{remedy}"):
        Dataset(tmp_path)
    with pytest.raises(RaucaError, match="not a data set"):
        Dataset(tmp_path / "nowhere")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weathers": ()}, "options: weathers must not be empty"),
        ({"ring": Ring((0.0,), (10.0,), (5.0, 0.0))}, "options: ring: distances_m must be above 0, not 0"),
        ({"ring": Ring((0.0,), (10.0,), (-6.0,))}, "options: ring: distances_m must be above 0, not -6"),
        ({"ring": Ring((), (10.0,), (5.0,))}, "options: ring: azimuths_deg must not be empty"),
    ],
)
def test_a_plan_that_cannot_be_rendered_is_refused(change, message):
    PLAN.check("options")
    with pytest.raises(RaucaError, match=message):
        replace(PLAN, **change).check("options")


def test_camouflage_round_trip_and_fit(tmp_path):
    camouflage = Camouflage("c", "box", "abc", 8, "random", {"seed": 1})
    save_camouflage(tmp_path / "c.json", camouflage, png_bytes(np.zeros((8, 8, 3), np.uint8)))
    again, image = load_camouflage(tmp_path / "c.png")
    assert (again, image.name) == (camouflage, "c.png")
    again.check_fits("abc", "c.json")
    with pytest.raises(RaucaError, match=r"c\.json: made for box in another UV layout"):
        again.check_fits("xyz", "c.json")
    image.unlink()
    with pytest.raises(RaucaError, match=r"c\.png: the camouflage's UV map is missing"):
        load_camouflage(tmp_path / "c.json")


def test_transfer_function_inverts_itself():
    x = np.linspace(0, 1, 1001, dtype=np.float32)
    assert np.allclose(linear_to_srgb(srgb_to_linear(x)), x, atol=1e-5)
    assert linear_to_srgb(np.array([np.nan, -1.0, 7.0])) == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)


def test_seeds_depend_on_names_alone():
    assert named_seed(1, "a") == named_seed(1, "a")
    assert len({named_seed(s, n) for s in range(10) for n in "abc"}) == 30
    assert named_rng(1, "x").random() == named_rng(1, "x").random()
