"""Step 6 as an artist uses it: a camouflage goes over the materials and off again; boxes of an evaluation are found."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon.scene.camera import place
from blender_addon.scene.render import prepare, render_linear
from blender_addon.scene.vehicle import load_shipped
from blender_addon.steps import bake
from blender_addon.steps.camouflage import detection_overlay, panel, shown_evaluation, views_panel
from blender_addon.steps.camouflage.painted_vehicle import painted_surface
from rauca_core.contract import Camera, Frame, Quality, Weather
from rauca_core.contract.files import png_bytes, write_json
from rauca_core.study.results import AXES, FrameRow, ImageRow, save_results
from tests.blender.round_trip import daylight, look_around
from tests.study.measured import made_up

from .conftest import refusal
from .painted_box import a_box, a_camouflage, painted_box


@pytest.fixture
def rauca(addon):
    """The scene's settings, in an empty scene."""
    return addon.context.scene.rauca


def state():
    return panel.state(bpy.context)


def test_the_paint_is_covered_and_given_back(rauca, tmp_path):
    box = a_box()
    tree = box.data.materials[0].node_tree
    shader = tree.nodes["Principled BSDF"]
    before = len(tree.nodes), len(tree.links), tuple(shader.inputs["Base Color"].default_value)
    atlas = rauca.vehicle.chosen(bpy.context).atlas_id
    a_camouflage(tmp_path)
    assert state().kind == "ready"
    assert bpy.ops.rauca.apply_camouflage() == {"FINISHED"}
    assert [slot.material.name for slot in box.material_slots] == ["body paint", "glass"]
    assert shader.inputs["Base Color"].is_linked
    assert shader.inputs["Metallic"].is_linked
    assert not box.data.materials[1].node_tree.nodes["Principled BSDF"].inputs["Base Color"].is_linked
    marks = [value.value for value in box.data.attributes["rauca_painted"].data]
    assert marks == [float(polygon.material_index == 0) for polygon in box.data.polygons]
    assert rauca.vehicle.chosen(bpy.context).atlas_id == atlas  # the vehicle is still the one it was made for
    assert state().words == "The vehicle wears spots"
    assert bpy.ops.rauca.remove_camouflage() == {"FINISHED"}
    assert before == (len(tree.nodes), len(tree.links), tuple(shader.inputs["Base Color"].default_value))
    assert not shader.inputs["Base Color"].is_linked
    assert "rauca_painted" not in box.data.attributes
    assert not bpy.data.images
    assert not bpy.data.node_groups
    assert not bpy.ops.rauca.remove_camouflage.poll()


def test_a_texture_below_stays_the_vehicles_own(rauca, tmp_path):
    box = a_box()
    tree = box.data.materials[0].node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.new("bodywork", 128, 128)
    shader = tree.nodes["Principled BSDF"]
    tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    atlas = rauca.vehicle.chosen(bpy.context).atlas_id
    a_camouflage(tmp_path)
    for _ in range(2):  # on top of itself it is replaced
        bpy.ops.rauca.apply_camouflage()
        assert rauca.vehicle.chosen(bpy.context).atlas_id == atlas
    assert sum(node.type == "GROUP" for node in tree.nodes) == 1
    bpy.ops.rauca.remove_camouflage()
    assert shader.inputs["Base Color"].links[0].from_node == texture


def test_it_shows_in_renders_on_the_paint_alone(rauca, tmp_path):
    a_box()
    a_camouflage(tmp_path, np.full((8, 8, 3), (0, 255, 0), np.uint8))
    bpy.ops.rauca.apply_camouflage()
    scene = bpy.context.scene
    surface, _coat = painted_surface(bpy.context)
    daylight(scene)
    prepare(scene)
    scene.render.film_transparent = True
    place(scene, look_around(surface, 48, 30.0)[0])
    shots = {}
    for which in ("ORIGINAL", "CAMOUFLAGE"):
        assert bpy.ops.rauca.show_paint(which=which) == {"FINISHED"}
        shots[which] = render_linear(scene, Quality(4, denoise=False), seed=1)[..., :3]
    bpy.ops.rauca.remove_camouflage()
    bare = render_linear(scene, Quality(4, denoise=False), seed=1)[..., :3]
    assert np.abs(bare - shots["ORIGINAL"]).max() < 1e-4
    changed = np.abs(bare - shots["CAMOUFLAGE"]).max(axis=2) > 0.02
    there = bare.max(axis=2) > 0.02
    assert 0.3 < changed[there].mean() < 0.95  # the sides, but not the roof
    green = shots["CAMOUFLAGE"][changed].mean(axis=0)
    assert green[1] > 3 * green[0]


@pytest.mark.parametrize("remove", [lambda box: bpy.data.objects.remove(box), lambda box: bpy.ops.object.delete()])
def test_a_deleted_vehicle_wears_nothing(rauca, tmp_path, remove):
    box = painted_box(tmp_path)
    remove(box)
    assert (state().kind, state().words) == ("missing", "The vehicle that wore spots is no longer in this scene")
    assert bake.state(bpy.context).words == "Apply a camouflage first"


def test_toggle_and_undo(rauca, tmp_path):
    painted_box(tmp_path)
    bpy.ops.ed.undo_push(message="painted")
    assert bpy.ops.rauca.show_paint("EXEC_DEFAULT", True) == {"FINISHED"}
    assert state().words == "The original paint shows; spots is hidden"
    bpy.ops.ed.undo()
    assert state().words == "The vehicle wears spots"
    assert "Nothing is baked yet" in refusal(bpy.ops.rauca.show_paint, which="BAKED")
    bpy.ops.rauca.remove_camouflage("EXEC_DEFAULT", True)
    bpy.ops.ed.undo()
    assert bpy.data.materials["body paint"].node_tree.nodes["rauca camouflage"].node_tree is not None
    assert bpy.context.scene.rauca.camouflage.coat.nodes["camouflage"].image.packed_file is not None


def test_the_vehicle_it_was_made_for_is_added(rauca, tmp_path):
    a_camouflage(tmp_path, atlas_id=load_shipped("sedan").atlas_id, vehicle="sedan")
    bpy.ops.ed.undo_push(message="before")
    assert bpy.ops.rauca.apply_camouflage("EXEC_DEFAULT", True) == {"FINISHED"}
    assert bpy.context.scene.rauca.vehicle.object == bpy.data.objects["sedan"]
    bpy.ops.ed.undo()
    assert "sedan" not in bpy.context.scene.objects
    rauca = bpy.context.scene.rauca
    rauca.vehicle.origin, rauca.vehicle.file = "FILE", "sedan"
    for _ in range(2):  # the second time it is there
        assert bpy.ops.rauca.apply_camouflage() == {"FINISHED"}
        assert len(bpy.context.scene.objects) == 1


def png() -> Path:
    return Path(bpy.context.scene.rauca.camouflage.file).with_suffix(".png")


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda box: None, "made for Box in another UV layout"),
        (lambda box: setattr(bpy.context.scene.rauca.camouflage, "file", ""), "choose its .json or .png file"),
        (lambda box: setattr(bpy.context.scene.rauca.camouflage, "file", "/nowhere/c.json"), "not found"),
        (lambda box: box.data.materials[0].node_tree.nodes.clear(), "has no Principled BSDF"),
        (lambda box: png().unlink(), "keep the .png beside the .json"),
        (lambda box: setattr(bpy.context.scene.rauca.vehicle, "object", None), "pick an object of this scene"),
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_changes(rauca, tmp_path, spoil, told):
    box = a_box()
    a_camouflage(tmp_path, atlas_id="" if "BSDF" in told else "0" * 16)
    spoil(box)
    nodes = len(box.data.materials[0].node_tree.nodes)
    assert told in refusal(bpy.ops.rauca.apply_camouflage)
    assert len(box.data.materials[0].node_tree.nodes) == nodes
    assert not bpy.data.images
    assert "rauca_painted" not in box.data.attributes


def test_modifiers_that_add_faces_keep_the_paint(rauca, tmp_path):
    box = a_box()
    box.modifiers.new("more", "SUBSURF").subdivision_type = "SIMPLE"
    a_camouflage(tmp_path)
    assert bpy.ops.rauca.apply_camouflage() == {"FINISHED"}
    assert sum(value.value for value in box.data.attributes["rauca_painted"].data) == 5


def an_evaluation(folder, camera: Camera) -> None:
    """A study's results of one view in two weathers: found as it was, and with a low score in camouflage."""
    frames, images, box = [], {"normal": (), "spots": ()}, (10, 20, 50, 60)
    (folder / "detections").mkdir(parents=True)
    lines = []
    for weather in ("clear", "fog"):
        name = f"L00-V000-{weather}"
        frame = Frame(name, 0, 0, camera, np.eye(4), Weather(weather, 40.0), 30.0, 10.0, 8.0, box, 1.0, 1)
        write_json(folder / "frames" / name / "frame.json", frame.to_json())
        frames.append(FrameRow(name, weather, **dict.fromkeys(AXES, 1.0), box_xyxy=box))
        for paint, score in (("normal", 0.9), ("spots", 0.1)):
            sha = hashlib.sha256(f"{name}{paint}".encode()).hexdigest()
            images[paint] += (ImageRow(f"frames/{name}/image.png", sha),)
            lines.append({"image": sha, "boxes": [box], "scores": [score], "names": ["car"]})
    (folder / "detections" / "eye-0123456789ab.jsonl").write_text("".join(json.dumps(x) + "\n" for x in lines) + "{cut")
    (folder / "detections" / "eye-wide-0123456789ab.jsonl").write_text("")
    results = made_up(0, tuple(images), ("eye", "eye-wide"))
    save_results(folder / "results.json", replace(results, frames=tuple(frames), images=images))


def test_boxes_of_the_evaluated_view(rauca, tmp_path):
    camera = Camera.look_at(np.array([9.0, 4.0, 3.0]), np.array([0, 0, 0.7]), 40.0, 64, 64)
    an_evaluation(tmp_path, camera)
    box = painted_box(tmp_path)  # beside the evaluation: it is found by itself
    scene = bpy.context.scene
    assert rauca.camouflage.study == str(tmp_path)
    views = shown_evaluation.load_now(rauca.camouflage.study)
    assert views_panel._views(bpy.context) is views
    assert shown_evaluation.same_view(scene, views) == []
    assert bpy.ops.rauca.evaluated_view(step="NEAREST") == {"FINISHED"}
    seen = shown_evaluation.same_view(scene, views)
    assert [evaluated.weather for evaluated in seen] == ["clear", "fog"]
    assert scene.camera == rauca.camouflage.camera
    assert not scene.camera.data.background_images  # the study's pictures are gone
    assert detection_overlay.unfound(scene, seen[0]) == ["eye", "eye-wide"]
    assert detection_overlay.shown_detections(scene, seen[0]) == []  # the camouflage works
    bpy.ops.rauca.show_paint(which="ORIGINAL")
    ((detector, found),) = detection_overlay.shown_detections(scene, seen[0])
    assert (detector, found.box, found.score) == ("eye", (10, 20, 50, 60), 0.9)
    assert detection_overlay.unfound(scene, seen[0]) == ["eye-wide"]
    bpy.ops.rauca.evaluated_view(step="WEATHER")
    assert rauca.camouflage.frame == "L00-V000-fog"
    box.location.x += 3.0  # the vehicle moves, and the view with it
    bpy.context.view_layer.update()
    assert shown_evaluation.same_view(scene, views) == []
    bpy.ops.rauca.evaluated_view(step="NEAREST")
    assert len(shown_evaluation.same_view(scene, views)) == 2
    scene.camera.location.z += 1.0
    bpy.context.view_layer.update()
    assert shown_evaluation.same_view(scene, views) == []


def test_the_evaluated_picture_lies_over_its_view_and_leaving_takes_all_away(rauca, tmp_path):
    an_evaluation(tmp_path, Camera.look_at(np.array([9.0, 4.0, 3.0]), np.array([0, 0, 0.7]), 40.0, 64, 64))
    shot = tmp_path / "frames" / "L00-V000-clear" / "image.png"
    shot.write_bytes(png_bytes(np.full((64, 64, 3), 90, np.uint8)))
    painted_box(tmp_path)
    scene, size, images = bpy.context.scene, bpy.context.scene.render.resolution_x, len(bpy.data.images)
    own = scene.camera
    assert "No view is being looked through" in refusal(bpy.ops.rauca.leave_evaluated_view)
    bpy.ops.rauca.show_paint(which="ORIGINAL")
    assert bpy.ops.rauca.evaluated_view(step="NEAREST") == {"FINISHED"}
    (laid,) = scene.camera.data.background_images
    assert Path(laid.image.filepath) == shot
    assert scene.camera.data.show_background_images
    rauca.camouflage.picture = False
    assert not scene.camera.data.show_background_images
    rauca.camouflage.picture = True
    bpy.ops.rauca.evaluated_view(step="WEATHER")  # whose file is gone
    assert not scene.camera.data.background_images
    bpy.ops.rauca.evaluated_view(step="WEATHER")
    assert len(scene.camera.data.background_images) == 1
    assert bpy.ops.rauca.leave_evaluated_view() == {"FINISHED"}
    assert (scene.camera, scene.render.resolution_x, len(bpy.data.images)) == (own, size, images)
    assert not bpy.data.cameras


def test_a_file_that_is_no_camouflage_is_told_before_it_is_applied(rauca, tmp_path):
    a_box()
    path = a_camouflage(tmp_path)
    assert state().words == "Ready to apply spots, made for Box"
    path.write_text("{")
    rauca.camouflage.file = str(path.with_name("other.json"))
    assert state().kind == "missing"


def test_no_evaluation_is_told_in_words(rauca, tmp_path):
    painted_box(tmp_path)
    assert not bpy.ops.rauca.evaluated_view.poll()
    assert "No evaluation yet" in views_panel._views(bpy.context)
    rauca.camouflage.study = str(tmp_path)
    assert "holds no evaluation" in refusal(bpy.ops.rauca.evaluated_view)
