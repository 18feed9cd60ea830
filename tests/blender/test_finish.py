"""Paint finishes: each stays affine in its color, dry and wet, and they reflect as their names promise."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from blender_addon.scene import camera, render
from blender_addon.scene.render import render_linear
from blender_addon.scene.vehicle import SceneVehicle, load_shipped
from blender_addon.scene.wetness import set_wetness
from rauca_core.contract import Camera, Quality, RaucaError
from rauca_core.contract.color import linear_to_srgb

from .conftest import psnr
from .round_trip import daylight

RED = (0.5, 0.1, 0.05)


class Studio:
    """A sphere, which faces every light, under a grey sky and a sun."""

    def __init__(self, finish: str) -> None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene = bpy.data.scenes.new("studio")
        render.prepare(self.scene)
        self.scene.render.film_transparent = True
        daylight(self.scene)
        self.vehicle = SceneVehicle(self.scene, load_shipped("sphere"), finish)
        eye = Camera.look_at(np.array([7.0, 1.0, 3.0]), np.array([0.0, 0.0, 1.5]), 30.0, 64, 64)
        camera.place(self.scene, eye)

    def render(self, color: tuple[float, float, float]) -> np.ndarray:
        """(N, 3) linear pixels well inside the sphere."""
        self.vehicle.paint.set_color(color)
        pixels = render_linear(self.scene, Quality(samples=64, denoise=False), 1)
        return pixels[..., :3][pixels[..., 3] == 1]


@pytest.mark.parametrize("wetness", [0.0, 1.0])
@pytest.mark.parametrize("finish", ["car_paint", "sticker"])
def test_a_white_and_a_black_render_predict_a_color_they_never_saw(finish, wetness):
    studio = Studio(finish)
    set_wetness(wetness, 0.0)
    white, black, red = (studio.render(color) for color in ((0.8,) * 3, (0.0,) * 3, RED))
    predicted = black + (white - black) / np.float32(0.8) * np.float32(RED)
    assert len(red) > 500
    assert psnr(linear_to_srgb(predicted), linear_to_srgb(red)) > 40


def test_car_paint_shines_and_a_sticker_does_not():
    """What a black ball sends back is its highlights alone: a sharp image of the sun, or a haze around it."""
    shine, haze = (Studio(finish).render((0.0, 0.0, 0.0)).mean(axis=1) for finish in ("car_paint", "sticker"))
    assert shine.max() > 10 * haze.max()
    assert (haze > haze.max() / 2).mean() > 5 * (shine > shine.max() / 2).mean()


def test_water_makes_a_sticker_glossier():
    studio = Studio("sticker")
    dry = studio.render((0.0, 0.0, 0.0))
    set_wetness(1.0, 0.0)
    assert studio.render((0.0, 0.0, 0.0)).max() > 2 * dry.max()


def test_an_unknown_finish_is_refused_in_one_line():
    with pytest.raises(RaucaError, match="finish must be one of own, car_paint, sticker, not 'chrome'"):
        Studio("chrome")


def test_materials_carry_their_semantic_class():
    car = load_shipped("sedan")
    placed = SceneVehicle(bpy.data.scenes.new("classes"), car)
    classes = {m.name: b["rauca_class"] for m, b in zip(car.materials, placed.materials, strict=True)}
    assert (classes["paint"], classes["glass"], classes["tyre"]) == ("paint", "glass", "tyre")
    assert {c for m, c in classes.items() if m not in ("paint", "glass", "tyre")} == {"vehicle_part"}
