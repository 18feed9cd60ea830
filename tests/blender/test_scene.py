"""What the scene promises: true coverage, boxes, distances, light maps, exposure."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from blender_addon.scene import nodes
from blender_addon.scene.frame import rain_before
from blender_addon.scene.light_maps import light_maps
from blender_addon.scene.vehicle import SceneVehicle
from rauca_core.contract import Weather, rain
from rauca_core.contract.color import linear_to_srgb, to_bytes
from rauca_core.runtime.images import read_image

from .conftest import psnr


def test_coverage_box_and_distance_are_the_geometrys(session, box_vehicle):
    annotation = session.annotations(0, [0])[0]
    viewpoint = session.viewpoint(0, 0)
    pose = session.place.pose(0)
    corners = box_vehicle.positions @ pose[:3, :3].T + pose[:3, 3]
    pixels, _ = viewpoint.camera.project(corners)
    expected = (*pixels.min(axis=0), *pixels.max(axis=0))
    assert annotation.box_xyxy() == pytest.approx(expected, abs=1.0)
    assert annotation.vehicle.max() == 255
    painted = annotation.paint.astype(int)
    assert (painted <= annotation.vehicle.astype(int) + 1).all()
    share = (painted > 127).sum() / (annotation.vehicle > 127).sum()
    assert 0.3 < share < 0.95  # the top and the gutters are not paint

    nearest = np.linalg.norm(corners - viewpoint.camera.position, axis=1).min()
    inside = annotation.distance[annotation.vehicle == 255].astype(float)
    assert inside.min() == pytest.approx(nearest, rel=0.03)
    assert np.isinf(annotation.distance[0]).any()  # sky along the top row


def test_the_scene_is_as_before_after_annotation(session):
    def slots():
        return {o.name: [s.material.name for s in o.material_slots] for o in session.scene.objects}

    session.render(0, 0, session.plan.weathers[0])
    before = slots()
    session.annotations(0, [0])
    assert slots() == before
    image = session.render(0, 0, session.plan.weathers[0])
    session.annotations(0, [1])
    session.set_weather(Weather("fog", 45, 60, 60))
    session.render(0, 1, Weather("fog", 45, 60, 60))
    session.set_weather(session.plan.weathers[0])
    # A frame is the same bits whatever was rendered before it, once a first annotation has been made, as jobs do.
    assert np.array_equal(session.render(0, 0, session.plan.weathers[0]), image)


RAIN = Weather("rain", 40, 60, 20, cloudiness=95, precipitation=70, precipitation_deposits=70, wetness=90)


@pytest.mark.parametrize("weather", [Weather("day", 45), Weather("fog", 45, 60, 60), Weather("night", -30), RAIN])
def test_light_maps_predict_a_color_they_never_saw(session, weather):
    session.set_weather(weather)
    annotation = session.annotations(0, [0])[0]
    painted = annotation.paint > 0
    color = np.array([0.5, 0.1, 0.25], np.float32)
    A, B, _ = light_maps(session, 0, 0, weather, painted, np.full(3, 0.26, np.float32))
    assert np.isfinite(A).all()
    assert A[~painted].max() == 0
    session.vehicle.paint.set_color((0.5, 0.1, 0.25))
    rendered, predicted = session.render(0, 0, weather), A * color + B
    if drops := rain_before(session, 0, 0, weather, annotation.distance):
        assert np.array_equal(drops.alpha, rain_before(session, 0, 0, weather, annotation.distance).alpha)
        rendered, predicted = rain.over(rendered, drops), rain.over_gain(A, drops) * color + rain.over(B, drops)
    rendered, predicted = linear_to_srgb(rendered), linear_to_srgb(predicted)
    assert psnr(rendered[painted], predicted[painted]) > 34
    assert psnr(rendered[~painted], predicted[~painted]) > 34


def test_a_uv_map_lands_where_the_uvs_say(session, box_vehicle):
    """Each side of the box is a chart of its own; paint the +x side's chart red and look at it."""
    uv_map = np.zeros((64, 64, 3), np.uint8)
    uv_map[32:, 32:] = (0, 0, 255)  # chart 1, u > 0.5 and v < 0.5, is the +x side: rows count from the top
    session.vehicle.paint.set_map(uv_map)
    image = session.render(0, 0, session.plan.weathers[0])
    blue = linear_to_srgb(image)[..., 2] - linear_to_srgb(image)[..., 0]
    pose = session.place.pose(0)
    side = np.array([[2.0, 0.0, 0.75], [0.0, 1.0, 0.75]]) @ pose[:3, :3].T + pose[:3, 3]
    (front, left), _ = session.viewpoint(0, 0).camera.project(side)
    assert blue[int(front[1]), int(front[0])] > 0.2
    assert abs(blue[int(left[1]), int(left[0])]) < 0.1
    session.vehicle.paint.set_map(np.zeros_like(uv_map))  # a second map must not show stale pixels
    again = linear_to_srgb(session.render(0, 0, session.plan.weathers[0]))
    assert again[int(front[1]), int(front[0]), 2] - again[int(front[1]), int(front[0]), 0] < 0.1


def test_display_transform_is_blenders_standard(session, tmp_path):
    linear = session.render(0, 0, session.plan.weathers[0])
    scene = session.scene
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGB"
    scene.render.image_settings.color_depth = "8"
    scene.render.dither_intensity = 0
    scene.render.filepath = str(tmp_path / "blender.png")
    bpy.ops.render.render(write_still=True, scene=scene.name)
    difference = read_image(tmp_path / "blender.png").astype(int) - to_bytes(linear_to_srgb(linear))
    assert np.abs(difference).max() <= 1


def test_lamps_are_lit_in_a_blender_of_another_language(box_vehicle, named_in_german):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    materials = [m if m.kind == "paint" else replace(m, kind="headlamp") for m in box_vehicle.materials]
    vehicle = SceneVehicle(bpy.data.scenes.new("rauca"), replace(box_vehicle, materials=materials))
    vehicle.light_lamps(1.0)
    shaders = [nodes.principled(material.node_tree) for material in vehicle.materials]
    assert [shader.inputs["Emission Strength"].default_value for shader in shaders] == [0.0, 12.0]
