"""Fog composed around the vehicle: true to the real volume, exact where it must be, the same bytes from any history."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blender_addon.scene import composed_fog
from blender_addon.scene.light_maps import light_maps
from blender_addon.scene.session import LightMemory, PaintLight
from rauca_core.contract import Camera, Quality, Weather
from rauca_core.contract.color import linear_to_srgb

from .conftest import psnr, small_plan, small_session

CLEAR, FOG = Weather("clear", 45.0), Weather("fog", 45.0, 60.0, 50.0)
GREY = np.full(3, 0.26, np.float32)


def psnr_srgb(a, b):
    return psnr(linear_to_srgb(a), linear_to_srgb(b))


@pytest.mark.parametrize("size", [(48, 64), (45, 63)])
def test_dimming_by_transmittance_and_a_smooth_glow_are_composed(size):
    rng = np.random.default_rng(0)
    clear = rng.random((*size, 3)).astype(np.float32)
    distance = np.broadcast_to(np.linspace(4, 40, size[1]), size)
    through = np.exp(-0.02 * distance)[..., None]
    fogged = (through * clear + (1 - through) * 0.5).astype(np.float32)
    padded = np.pad(fogged, ((0, -size[0] % 4), (0, -size[1] % 4), (0, 0)), mode="edge")
    coarse = padded.reshape(padded.shape[0] // 4, 4, padded.shape[1] // 4, 4, 3).mean(axis=(1, 3))
    assert psnr_srgb(composed_fog.compose(coarse, clear, distance, 0.02), fogged) > 40


def test_black_pictures_and_endless_skies_stay_finite():
    black, sky = np.zeros((16, 16, 3), np.float32), np.full((16, 16), np.inf, np.float16)
    composed = composed_fog.compose(np.full((4, 4, 3), 0.3, np.float32), black, sky, 0.05)
    assert np.isfinite(composed).all()
    assert composed == pytest.approx(0.3, abs=1e-3)


@pytest.mark.parametrize("aside", [-1.0, 0.25, 1.0])
def test_the_sun_leaves_no_holes_beside_it(aside):
    """It stands over roofs; the denoiser spreads it in the coarse picture, ``aside`` pixels of it from where it is."""
    rows, columns = np.mgrid[:128, :96]
    sky = rows < 44 + columns // 8
    distance = np.where(sky, np.inf, 30.0)
    light = np.where(sky, 8.0, 0.1)[..., None] * np.ones(3)
    clear = light.copy()
    clear[36:40, 46:49] = 4e5
    rows, columns = np.mgrid[:32, :24]
    spread = 1e4 * np.exp(-((rows - 9) ** 2 + (columns - 11.5 + aside) ** 2))
    coarse = light.reshape(32, 4, 24, 4, 3).mean(axis=(1, 3)) + spread[..., None]
    composed = composed_fog.compose(coarse.astype(np.float32), clear.astype(np.float32), distance, 0.015)
    assert composed.min() > 0.09
    assert composed[36:40, 46:49].min() > 1


def test_a_rendered_part_fades_out_except_at_the_frames_border():
    inside = (slice(0, 40), slice(20, 60))
    blended = composed_fog.blend(np.zeros((60, 80, 3), np.float32), np.ones((40, 40, 3), np.float32), inside)
    assert blended[0, 40, 0] == 1.0
    assert 0 < blended[39, 40, 0] < 0.1
    assert 0 < blended[10, 20, 0] < 0.1
    assert blended[50].max() == blended[:, 70].max() == 0.0


def test_the_coarse_camera_sees_the_same_directions():
    camera = Camera.look_at(np.array([5.0, 1, 2]), np.zeros(3), 60, 94, 94, 5)
    fine, _ = camera.project(np.array([[0.5, -0.3, 0.2]]))
    coarse, _ = composed_fog.coarse_camera(camera).project(np.array([[0.5, -0.3, 0.2]]))
    assert coarse * composed_fog.COARSE == pytest.approx(fine)
    assert (composed_fog.coarse_camera(camera).width, composed_fog.coarse_camera(camera).height) == (24, 24)


@pytest.fixture
def foggy(box_vehicle):
    """A session whose plan composes fog."""
    session = small_session(box_vehicle, weathers=(CLEAR, FOG), quality=Quality(8, composed_fog=True), size=128)
    session.enter(0)
    return session


def maps(session, weather, annotation):
    session.set_weather(weather)
    return light_maps(session, 0, 0, weather, annotation.paint > 0, GREY, annotation)


def test_composed_fog_is_the_real_one_and_its_bytes_do_not_depend_on_the_past(foggy):
    session = foggy
    annotation = session.annotations(0, [0])[0]
    alone = maps(session, FOG, annotation)
    session.memory = type(session.memory)(session.plan)
    maps(session, CLEAR, annotation)
    after_clear = maps(session, FOG, annotation)
    assert all(np.array_equal(a, b) for a, b in zip(alone, after_clear, strict=True))

    session.plan = replace(session.plan, quality=Quality(24))
    session.memory = type(session.memory)(session.plan)
    A, _, image = maps(session, FOG, annotation)
    assert A[annotation.paint == 0].max() == 0
    assert psnr_srgb(alone[2], image) > 33
    assert psnr_srgb(alone[0][annotation.paint > 0], A[annotation.paint > 0]) > 30


def test_memory_holds_one_light_at_a_time():
    low, night, same_night = Weather("low", 10.0), Weather("night", -90.0), Weather("same", -30.0)
    foggy_low = replace(low, name="foggy", fog_density=50.0)
    plan = small_plan("atlas", weathers=(low, foggy_low, night, same_night), quality=Quality(8, composed_fog=True))
    memory, light = LightMemory(plan), PaintLight(*np.zeros((2, 4, 4, 3), np.float32))
    memory.keep(0, 0, low, light)
    memory.keep(0, 1, low, light)
    assert memory.get(0, 0, replace(foggy_low, fog_density=0.0)) is memory.get(0, 1, low) is light
    memory.keep(0, 1, foggy_low, light)  # nothing is composed on it, no other weather is the same
    assert memory.get(0, 1, foggy_low) is None
    memory.keep(0, 0, night, light)
    assert memory.get(0, 0, same_night) is light
    assert memory.get(0, 0, low) is None
    memory.keep(1, 0, night, light)
    assert memory.get(0, 0, night) is None
