"""Ids and the visible share of the paint: exact numbers, from geometry alone."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from blender_addon.scene import annotate, nodes
from blender_addon.scene.frame import render_frame
from blender_addon.scene.massing import BOX_FACES
from rauca_core.contract import load_frame, load_passes
from rauca_core.contract.color import TEST, linear_to_srgb, recolor
from rauca_core.contract.semantics import CLASS_IDS
from rauca_core.runtime.images import read_image

from .conftest import mesh_object, psnr


def add_cube(session, location, size, **properties):
    corners = np.array([(x, y, z) for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    thing = mesh_object("cube", corners * size, BOX_FACES)
    thing.location = tuple(location)
    for name, value in properties.items():
        thing[name] = value
    session.scene.collection.objects.link(thing)
    return thing


def beside(session, sideways_m, towards_camera):
    """A point off the line from the vehicle to the camera of view 0; 0 is at the vehicle, 1 at the camera."""
    center = session.place.pose(0)[:3, 3] + [0, 0, 0.75]
    eye = session.viewpoint(0, 0).camera.position
    right = session.viewpoint(0, 0).camera.R[0]
    return center + (eye - center) * towards_camera + right * sideways_m


def test_ids_are_whole_and_agree_with_coverage(session):
    seen = session.annotations(0, [0])[0]
    ours = np.isin(seen.semantic, [CLASS_IDS["paint"], CLASS_IDS["vehicle_part"]])
    assert np.array_equal(ours, seen.instances == 255)
    inside, outside = seen.vehicle == 255, seen.vehicle == 0
    assert ours[inside].all()
    assert not ours[outside].any()
    assert (seen.semantic[seen.paint == 255] == CLASS_IDS["paint"]).all()
    assert (seen.semantic[inside & (seen.paint == 0)] == CLASS_IDS["vehicle_part"]).all()
    differing = (seen.semantic == CLASS_IDS["sky"]) != np.isinf(seen.distance)
    assert differing.mean() < 0.01  # on edges only: one is a sample, the other half of an area
    parked = [instance.id for instance in seen.others]
    assert sorted(parked) == sorted(set(np.unique(seen.instances).tolist()) - {0, 255})


def test_the_vehicle_is_resolved_as_if_the_whole_frame_were(session, monkeypatch):
    seen = session.annotations(0, [0])[0]
    monkeypatch.setattr(annotate, "FEW_SAMPLES", annotate.SAMPLES)
    whole = session.annotations(0, [0])[0]
    assert np.array_equal(seen.vehicle, whole.vehicle)
    assert np.array_equal(seen.paint, whole.paint)
    near = whole.vehicle > 0
    assert np.array_equal(seen.distance[near], whole.distance[near])
    both = np.isfinite(seen.distance) & np.isfinite(whole.distance)
    off = np.abs(seen.distance[both].astype(float) / whole.distance[both].astype(float) - 1)
    assert np.median(off) < 0.005


def test_other_vehicles_are_numbered_and_surfaces_named_by_their_material(session):
    add_cube(session, beside(session, -3.0, 0.2), 1.5, rauca_instance=201, rauca_category="truck")
    post = add_cube(session, beside(session, 2.6, 0.2), 0.8)
    material = bpy.data.materials.new("post")
    material["rauca_class"] = "pole"
    post.data.materials.append(material)
    seen = session.annotations(0, [0])[0]
    truck = seen.instances == 201
    (found,) = (instance for instance in seen.others if instance.id == 201)
    assert (found.category, found.pixels) == ("truck", truck.sum())
    rows, columns = np.nonzero(truck)
    assert found.box_xyxy == (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1)
    assert (seen.semantic[truck] == CLASS_IDS["other_vehicle"]).all()
    assert (seen.semantic == CLASS_IDS["pole"]).sum() > 20
    assert {0, 201, 255} <= set(np.unique(seen.instances).tolist())
    assert post.material_slots[0].material == material
    assert len(session.scene.objects["cube"].material_slots) == 0  # the bare cube is bare again


def test_the_visible_share_is_pixels_seen_over_pixels_expected(session):
    alone = session.annotations(0, [0])[0]
    assert alone.visible > 0.97
    wall = add_cube(session, beside(session, 0.9, 0.5), 1.0)
    hidden = session.annotations(0, [0])[0]
    paint = CLASS_IDS["paint"]
    counted = (hidden.semantic == paint).sum() / (alone.semantic == paint).sum()
    assert 0.2 < counted < 0.8
    assert hidden.visible == pytest.approx(counted * alone.visible, abs=0.02)
    wall.scale = (4, 4, 4)
    assert session.annotations(0, [0])[0].visible < 0.05


def test_a_container_of_fog_hides_nothing(session):
    before = session.annotations(0, [0])[0]
    haze = add_cube(session, beside(session, 0.0, 0.5), 3.0)
    material = bpy.data.materials.new("haze")
    tree = nodes.fresh_tree(material)
    nodes.output(tree, Volume=nodes.add(tree, "ShaderNodeVolumeScatter").outputs[0])
    haze.data.materials.append(material)
    after = session.annotations(0, [0])[0]
    assert np.array_equal(after.semantic, before.semantic)
    assert np.array_equal(after.paint, before.paint)
    assert after.visible == before.visible
    assert not haze.hide_render


def test_a_check_is_rendered_for_real_and_predicted_by_the_light_maps(session, tmp_path):
    session.plan = replace(session.plan, recolor_share=1.0)
    task = session.plan.frames()[0]
    seen = session.annotations(0, [0])[0]
    render_frame(session, tmp_path, task, seen)
    folder = tmp_path / "frames" / task.id
    frame, maps = load_frame(folder), load_passes(folder)
    assert frame.check_srgb in TEST
    painted = seen.paint == 255
    predicted = linear_to_srgb(recolor(maps["A"], maps["B"], frame.check_srgb))[painted]
    real = read_image(folder / "check.png")[painted] / 255
    assert psnr(predicted, real) > 34
    reference = read_image(folder / "image.png")[painted] / 255
    assert np.mean((reference - real) ** 2) > 20 * np.mean((predicted - real) ** 2)  # it is another color
