"""Step 7 as an artist uses it: the camouflage in another UV layer, as PNG, in the .blend and as GLB."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon.scene.bake import prepare_bake
from blender_addon.scene.vehicle import load_shipped
from blender_addon.steps.bake import BakeRun, RAUCA_OT_bake, bakeable, state
from blender_addon.steps.camouflage.painted_vehicle import painted_surface
from rauca_core.runtime.images import read_image
from tests.blender.round_trip import daylight, look_around, round_trip
from tests.faults.small_disk import small_disk

from .conftest import mesh_object, refusal
from .painted_box import a_camouflage, a_layer, painted_box


@pytest.fixture
def bake(addon, tmp_path):
    """The step's settings, in an empty scene, writing to a folder."""
    settings = addon.context.scene.rauca.bake
    settings.folder, settings.size = str(tmp_path / "out"), "512"
    return settings


@pytest.fixture
def box(bake, tmp_path):
    """A box in its camouflage, with another UV layer."""
    painted = painted_box(tmp_path)
    a_layer(painted, "other")
    return painted


def refused(bake, tmp_path) -> str:
    """What the bake says when it refuses; nothing was written."""
    words = refusal(bpy.ops.rauca.bake)
    assert not (tmp_path / "out").exists()
    assert bpy.context.scene.rauca.camouflage.coat.nodes["baked"].image is None
    return words


def exported(glb: Path) -> dict:
    """The JSON of the GLB that the step writes; the scene is left as it was."""
    kinds = bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.images
    before = [sorted(kind.keys()) for kind in kinds]
    assert bpy.ops.rauca.export_glb(filepath=str(glb)) == {"FINISHED"}
    assert [sorted(kind.keys()) for kind in kinds] == before
    data = glb.read_bytes()
    return json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])


def test_bake_writes_packs_and_shows(bake, tmp_path):
    assert state(bpy.context).words == "Apply a camouflage first"
    assert not bpy.ops.rauca.bake.poll()
    box = painted_box(tmp_path)
    assert state(bpy.context).words == "The vehicle has no other UV layer yet: press New UV Layer"
    a_layer(box, "other")
    assert bakeable(bpy.context) == ["other"]
    bake.layer = "UVMap"
    assert state(bpy.context).words == "Choose the UV layer to bake into"
    assert "UV layer 'UVMap': the camouflage lies there already; choose another" in refusal(bpy.ops.rauca.bake)
    bake.layer = ""
    assert state(bpy.context).kind == "ready"
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.rauca.bake("EXEC_DEFAULT", True) == {"FINISHED"}
    assert read_image(tmp_path / "out" / "Box-spots-other.png").shape == (512, 512, 3)
    settings = bpy.context.scene.rauca
    assert settings.bake.layer == "other"
    assert settings.bake.difference < 0.02
    coat = settings.camouflage.coat
    assert coat.nodes["baked"].image.packed_file is not None
    nodes = bpy.data.materials["body paint"].node_tree.nodes
    assert (nodes["rauca baked UVs"].uv_map, nodes["rauca atlas UVs"].uv_map) == ("other", "UVMap")
    assert state(bpy.context).kind == "done"
    settings.bake.decibels = 22.0
    assert state(bpy.context).kind == "ready"
    assert "it looks different" in state(bpy.context).words
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["Box-spots-other.png"]
    bpy.ops.ed.undo()
    assert bpy.context.scene.rauca.camouflage.coat.nodes["baked"].image is None


def test_the_round_trip_is_seen_alike_on_a_car(bake, tmp_path):
    texels = np.random.default_rng(1).random((16, 16, 3)).repeat(16, axis=0).repeat(16, axis=1) * 255
    a_camouflage(tmp_path, texels.astype(np.uint8), load_shipped("sedan").atlas_id, "sedan")
    bpy.ops.rauca.apply_camouflage()
    assert bpy.ops.rauca.new_uv_layer() == {"FINISHED"}
    bake.size = "1024"
    assert bpy.ops.rauca.bake() == {"FINISHED"}
    surface, coat = painted_surface(bpy.context)
    daylight(bpy.context.scene)
    vehicle_db, paint_db = round_trip(bpy.context.scene, coat, look_around(surface, 128, 40.0))
    assert paint_db > 38
    assert vehicle_db > paint_db


def test_a_new_layer_leaves_the_selected_vehicles_own_alone(bake, tmp_path):
    box = painted_box(tmp_path)
    box.select_set(True)
    before = [tuple(corner.vector) for corner in box.data.uv_layers[0].uv]
    assert bpy.ops.rauca.new_uv_layer() == {"FINISHED"}
    assert [tuple(corner.vector) for corner in box.data.uv_layers[0].uv] == before
    assert box.select_get()
    assert bpy.ops.rauca.bake() == {"FINISHED"}


def test_the_only_other_layer_is_taken_and_of_several_one_is_asked_for(bake, tmp_path):
    box = painted_box(tmp_path)
    assert "has no UV layer beside the camouflage's own" in refused(bake, tmp_path)
    a_layer(box, "one")
    a_layer(box, "two")
    assert "several UV layers: 'one', 'two'; choose" in refused(bake, tmp_path)
    bake.layer = "three"
    assert "UV layer 'three'" in refused(bake, tmp_path)
    bake.layer = "two"
    assert bpy.ops.rauca.bake() == {"FINISHED"}


def test_layers_that_cannot_hold_the_camouflage_are_refused(bake, tmp_path):
    box = painted_box(tmp_path)
    a_layer(box, "big", scale=2.0)
    bake.layer = "big"
    assert "reach beyond the image" in refused(bake, tmp_path)
    a_layer(box, "stacked", scale=1e-9)
    bake.layer = "stacked"
    assert "of the paint has no place in it" in refused(bake, tmp_path)
    for loop in box.data.uv_layers["stacked"].uv:
        loop.vector = (0.0, 0.0)
    for polygon in box.data.polygons:
        for corner, loop in zip(((0, 0), (0, 1), (1, 1), (1, 0)), polygon.loop_indices, strict=True):
            box.data.uv_layers["stacked"].uv[loop].vector = corner
    assert "100% of its texels lie on two parts at once" in refused(bake, tmp_path)
    bake.allow_overlaps = True
    assert bpy.ops.rauca.bake() == {"FINISHED"}


def test_other_tiles_are_the_same_image_repeated(bake, tmp_path):
    box = painted_box(tmp_path)
    a_layer(box, "here")
    a_layer(box, "next door", shift=1.0)
    pictures = []
    for layer in ("here", "next door"):
        bake.layer = layer
        assert bpy.ops.rauca.bake() == {"FINISHED"}
        pictures.append(read_image(tmp_path / "out" / f"{bpy.path.clean_name('Box-spots-' + layer)}.png"))
    assert np.abs(pictures[0].astype(int) - pictures[1]).max() <= 2
    assert bpy.context.scene.rauca.camouflage.coat.nodes["baked"].extension == "REPEAT"


def test_folders_that_cannot_be_written_to_and_lost_images_are_told(box, bake, tmp_path):
    bake.folder = ""
    assert "Choose a folder for the baked image" in refused(bake, tmp_path)
    bake.folder = str(tmp_path / "made" / "spots.json")
    assert "is a file, not a folder" in refused(bake, tmp_path)
    bake.folder = str(tmp_path / "out")
    bpy.data.images.remove(bpy.context.scene.rauca.camouflage.coat.nodes["camouflage"].image)
    assert "image is gone from this file; apply the camouflage again" in refused(bake, tmp_path)


def test_a_full_disk_leaves_no_picture_behind(box, bake, tmp_path):
    before = sorted(bpy.data.images.keys())
    (tmp_path / "disk").mkdir()
    with small_disk(tmp_path / "disk") as disk:
        if disk is None:
            pytest.skip("this user may not mount a disk")
        disk.fill()
        bake.folder = str(disk.seen / "baked")
        assert refused(bake, tmp_path).endswith("no space left on the disk; free some and start again")
    assert sorted(bpy.data.images.keys()) == before


def test_what_is_undone_while_a_bake_is_put_in_place_is_told(box, tmp_path):
    task = prepare_bake(*painted_surface(bpy.context), "other", 64, False)
    run = BakeRun(task, "other", tmp_path / "out" / "a.png")
    run.run()
    before = set(bpy.data.images)
    steps = RAUCA_OT_bake.finish(None, bpy.context, run)
    next(steps)
    (new,) = set(bpy.data.images) - before
    bpy.data.images.remove(new)
    assert "undone before it was in place; bake again" in refusal(next, steps)
    assert not (tmp_path / "out").exists()
    assert set(bpy.data.images) == before


def test_modifiers_and_a_changed_vehicle_are_told(box, bake, tmp_path):
    box.modifiers.new("more", "SUBSURF").subdivision_type = "SIMPLE"
    assert "apply" in refused(bake, tmp_path)
    box.modifiers.clear()
    box.data.polygons[0].material_index = 1
    assert "changed since the camouflage was applied" in refused(bake, tmp_path)


def test_glb_holds_the_baked_image_and_leaves_the_scene(box, tmp_path):
    assert not bpy.ops.rauca.export_glb.poll()
    bpy.ops.rauca.bake()
    document = exported(tmp_path / "car.glb")
    data = (tmp_path / "car.glb").read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    texture = next(m for m in document["materials"] if "baseColorTexture" in m["pbrMetallicRoughness"])
    used = document["textures"][texture["pbrMetallicRoughness"]["baseColorTexture"]["index"]]
    view = document["bufferViews"][document["images"][used["source"]]["bufferView"]]
    start = 20 + length + 8 + view.get("byteOffset", 0)
    (tmp_path / "held.png").write_bytes(data[start : start + view["byteLength"]])
    written = read_image(tmp_path / "out" / "Box-spots-other.png")
    assert np.abs(read_image(tmp_path / "held.png").astype(int) - written).max() <= 1
    assert texture["pbrMetallicRoughness"]["metallicFactor"] == 0


def test_glb_holds_wheels_that_are_instances_of_a_collection(bake, tmp_path):
    box = painted_box(tmp_path)
    collection = bpy.data.collections.new("wheel")
    collection.objects.link(mesh_object("wheel", [(0, 0, 0), (0.3, 0, 0), (0, 0, 0.3)], [(0, 1, 2)], "rubber"))
    for corner in ("left", "right"):
        wheel = bpy.data.objects.new(f"wheel {corner}", None)
        wheel.instance_type, wheel.instance_collection, wheel.parent = "COLLECTION", collection, box
        bpy.context.scene.collection.objects.link(wheel)
    bpy.context.view_layer.update()
    a_camouflage(tmp_path)
    assert bpy.ops.rauca.apply_camouflage() == {"FINISHED"}
    a_layer(box, "other")
    assert bpy.ops.rauca.bake() == {"FINISHED"}
    document = exported(tmp_path / "car.glb")
    assert sum("mesh" in node and node["name"].startswith("wheel") for node in document["nodes"]) == 2
    assert "rubber" in {material["name"] for material in document["materials"]}


def test_glb_is_written_in_a_blender_of_another_language(named_in_german, box, tmp_path):
    bpy.ops.rauca.bake()
    exported(tmp_path / "car.glb")


def test_a_bake_beside_the_window_stops_when_asked(box, tmp_path):
    task = prepare_bake(*painted_surface(bpy.context), "other", 512, False)
    whole, given_up = (BakeRun(task, "other", tmp_path / "a.png") for _ in range(2))
    given_up.stop()
    for run in (whole, given_up):
        run.start()
        run.join(60)
    assert (whole.result is not None, whole.done) == (True, 1.0)
    assert (given_up.result, given_up.error, given_up.done < 1.0) == (None, "", True)
