"""Weather in real renders of small scenes: exposure, clouds, twilight, fog, water, lamps, rain."""

import itertools
import math
from dataclasses import replace

import bpy
import numpy as np
import pytest

from blender_addon.scene import camera as placing
from blender_addon.scene import nodes, render, wetness
from blender_addon.scene.sky import exposure_stops
from blender_addon.scene.weather import SceneWeather, add_beams, headlamp_positions, shine
from rauca_core.contract import Camera, Material, Quality, Weather

from .conftest import mesh_object

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
FROM_ABOVE = Camera.look_at(np.array([0.0, 0.0, 10.0]), np.zeros(3), 60, 16, 16)
RAW = Quality(32, denoise=False)


class Yard:
    """A flat ground, a weather and whatever a test puts there."""

    def __init__(self, albedo=(0.18, 0.18, 0.18), porosity=None):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene = bpy.data.scenes.new("yard")
        render.prepare(self.scene)
        self.lamps = []
        corners = [(-60, -60, 0), (60, -60, 0), (60, 60, 0), (-60, 60, 0)]
        self.ground = self.add("ground", corners, [(0, 1, 2, 3)], self.material(albedo, porosity))
        self.weather = SceneWeather(self.scene, self.lamps)

    def material(self, albedo, porosity=None):
        material = bpy.data.materials.new("surface")
        tree = nodes.fresh_tree(material)
        color, roughness = (*albedo, 1.0), 0.8
        if porosity is not None:
            color, roughness = wetness.wet(tree, color, roughness, porosity)
        shader = nodes.add(tree, "ShaderNodeBsdfPrincipled", Base_Color=color, Roughness=roughness)
        nodes.output(tree, Surface=shader.outputs[0])
        return material

    def add(self, name, corners, faces, material):
        thing = mesh_object(name, corners, faces, material.name)
        self.scene.collection.objects.link(thing)
        return thing

    def lamp(self, position, energy=260.0):
        light = bpy.data.lights.new("lamp", "SPOT")
        light.energy, light.spot_size = energy, 2.5
        thing = bpy.data.objects.new("lamp", light)
        thing.location = position
        self.scene.collection.objects.link(thing)
        self.lamps.append(thing)

    def look(self, weather, camera=FROM_ABOVE, quality=RAW, seed=1):
        """(H, W) luminance."""
        return self.color(weather, camera, quality, seed) @ LUMINANCE

    def color(self, weather, camera=FROM_ABOVE, quality=RAW, seed=1):
        self.weather.apply(weather)
        placing.place(self.scene, camera)
        return render.render_linear(self.scene, quality, seed)[..., :3]


@pytest.fixture
def yard():
    return Yard()


@pytest.mark.parametrize(("cover", "altitudes"), [(0, (0, 5, 10, 30, 45, 90)), *((c, (90, 8)) for c in (50, 80, 100))])
def test_exposure_puts_a_grey_card_in_the_middle(yard, cover, altitudes):
    for altitude in altitudes:
        card = yard.look(Weather("w", altitude, cloudiness=cover)).mean()
        assert (0.18 if altitude else 0.1) < card < 0.33, altitude


def test_the_light_fades_through_twilight_without_a_step(yard):
    for cover in (0, 100):
        cards = [yard.look(Weather("w", sun, cloudiness=cover)).mean() for sun in (3, 0, -2, -5, -10, -17.9, -40)]
        assert all(after < before * 1.01 for before, after in itertools.pairwise(cards))
        assert all(after > before * 0.35 for before, after in itertools.pairwise(cards))
        assert cards[-1] == pytest.approx(cards[-2], rel=0.05)
        assert cards[-1] < 0.02


def test_clouds_soften_shadows(yard):
    """A post's shadow on the ground: deep and sharp under a clear sky, gone under an overcast one."""
    post = [(0.0, -0.5, 0), (0.0, 0.5, 0), (0.0, 0.5, 3), (0.0, -0.5, 3)]
    yard.add("post", post, [(0, 1, 2, 3)], yard.material((0.1, 0.1, 0.1)))
    above = Camera.look_at(np.array([-3.0, 0.01, 12.0]), np.array([-3.0, 0.0, 0.0]), 30, 48, 48)
    depths, soft = [], []
    for cover in (0, 60, 100):
        image = yard.look(Weather("w", 45, 0, cloudiness=cover), above, Quality(64, denoise=False))
        shade = 1 - image / np.percentile(image, 75)
        depths.append(np.percentile(shade, 97))
        soft.append(((shade > 0.3 * depths[-1]) & (shade < 0.7 * depths[-1])).sum() / (shade > 0.7 * depths[-1]).sum())
    assert depths[0] > depths[1] > depths[2]
    assert depths[0] > 0.6
    assert depths[2] < 0.4
    assert soft[0] < soft[1]


def test_equal_keys_are_equal_renders(yard):
    few = Quality(4, denoise=False)
    night = Weather("a", -90, 60, 50, cloudiness=30)
    first = yard.color(night, quality=few)
    assert np.array_equal(yard.color(Weather("b", -30, 200, 50, cloudiness=30), quality=few), first)
    yard.color(Weather("c", 30, 60, 50, fog_falloff=3.0), quality=few)  # another fog in between
    assert np.array_equal(yard.color(night, quality=few), first)


def test_fog_lies_low_where_it_falls_off(yard):
    """Black boards at 60 m: the share of fog before them follows the extinction at their height."""
    weather = Weather("w", 45, 0, 60, fog_falloff=3.0)
    black = yard.material((0.0, 0.0, 0.0))
    board = [(60, -40, 0), (60, 40, 0), (60, 40, 11), (60, -40, 11)]
    yard.add("board", board, [(0, 1, 2, 3)], black)
    veil = {}
    for height in (1.5, 9.0):
        level = Camera.look_at(np.array([20.0, 0.0, height]), np.array([60.0, 0.0, height]), 2, 8, 8)
        veil[height] = yard.look(weather, level, Quality(128, denoise=False)).mean()
    assert veil[9.0] < 0.35 * veil[1.5]
    low, high = (1 - np.exp(-40 * weather.extinction * 2 ** (-3.0 * height / 10)) for height in (1.5, 9.0))
    assert veil[9.0] / veil[1.5] == pytest.approx(high / low, rel=0.5)
    clear = Weather("w", 45, 0, 60, fog_falloff=3.0, fog_distance=60.0)
    low = Camera.look_at(np.array([20.0, 0.0, 1.5]), np.array([60.0, 0.0, 1.5]), 2, 8, 8)
    assert yard.look(clear, low, Quality(64, denoise=False)).mean() < 0.15 * veil[1.5]


@pytest.mark.parametrize("porosity", [0.0, 1.0])
def test_dry_is_bit_for_bit_what_it_was(porosity):
    weather = Weather("w", 30)
    plain = Yard((0.2, 0.1, 0.05)).color(weather)
    yard = Yard((0.2, 0.1, 0.05), porosity)
    assert np.array_equal(yard.color(weather), plain)
    yard.color(Weather("w", 30, wetness=80, precipitation_deposits=50))
    assert np.array_equal(yard.color(weather), plain)


def test_wet_ground_is_darker_and_glossier():
    yard = Yard(porosity=1.0)
    dry, wet = Weather("w", 40, 0, cloudiness=30), Weather("w", 40, 0, cloudiness=30, wetness=90)
    assert yard.look(wet).mean() < 0.6 * yard.look(dry).mean()
    # Towards the sun, at its mirror angle, water shines.
    far = 6 / math.tan(math.radians(40))
    towards_sun = Camera.look_at(np.array([-far, 0.0, 6.0]), np.zeros(3), 8, 16, 16)
    shine = [yard.look(w, towards_sun).mean() / yard.look(w).mean() for w in (dry, wet)]
    assert shine[1] > 3 * shine[0]


def test_puddles_cover_more_the_more_water_lies():
    yard = Yard(porosity=1.0)
    wide = Camera.look_at(np.array([0.0, 0.0, 30.0]), np.array([0.01, 0.0, 0.0]), 60, 48, 48)
    dark = []
    for deposits in (20, 50, 100):
        image = yard.look(Weather("w", 40, 0, cloudiness=100, precipitation_deposits=deposits), wide)
        dark.append(float((image < 0.5 * 0.2).mean()))
    assert dark[0] < dark[1] < dark[2]
    assert dark[0] < 0.3
    assert 0.6 < dark[2] < 0.98


def test_wet_paint_is_glossier_and_keeps_its_color():
    """Porosity 0: what the color adds is the same wet and dry, up to the water's own reflection."""
    rise = {}
    for water in (0, 90):
        weather = Weather("w", 40, 0, cloudiness=100, wetness=water)
        white = Yard((0.8, 0.8, 0.8), 0.0).look(weather).mean()
        black = Yard((0.0, 0.0, 0.0), 0.0).look(weather).mean()
        rise[water] = white - black
    assert rise[90] == pytest.approx(rise[0], rel=0.06)


def test_at_night_lamps_alone_light_the_street(yard):
    yard.lamp((0.0, 0.0, 6.0))
    under, beside = FROM_ABOVE, Camera.look_at(np.array([50.0, 0, 10]), np.array([50.0, 0.01, 0]), 60, 16, 16)
    night = Weather("w", -30)
    assert yard.look(night, under).mean() > 5 * yard.look(night, beside).mean()
    half = Weather("w", -3)  # lamps half way up
    dim, full = (
        (yard.look(weather, under).mean() - yard.look(weather, beside).mean())
        / 2.0 ** exposure_stops(weather.sun_altitude_angle)
        for weather in (half, night)
    )
    assert dim == pytest.approx(0.5 * full, rel=0.25)
    by_day = [yard.look(Weather("w", 30), camera).mean() for camera in (under, beside)]
    assert by_day[0] == pytest.approx(by_day[1], rel=0.05)


def test_headlamps_throw_light_ahead(yard, box_vehicle):
    assert headlamp_positions(box_vehicle).shape == (0, 3)
    front = box_vehicle.material.copy()
    front[2:4] = 2  # the +x side
    lit = replace(
        box_vehicle, material=front, materials=[*box_vehicle.materials, Material("lens", "headlamp", (1, 1, 1), 0.1)]
    )
    positions = headlamp_positions(lit)
    assert len(positions) == 1 or sorted(np.sign(positions[:, 1])) == [-1, 1]
    assert (positions[:, 0] > 2.0).all()
    anchor = bpy.data.objects.new("vehicle", None)
    yard.scene.collection.objects.link(anchor)
    beams = add_beams(yard.scene, anchor, lit)
    ahead = Camera.look_at(np.array([6.0, 0, 10]), np.array([6.0, 0.01, 0]), 30, 16, 16)
    behind = Camera.look_at(np.array([-6.0, 0, 10]), np.array([-6.0, 0.01, 0]), 30, 16, 16)
    shine(beams, 1.0)
    on, back = yard.look(Weather("w", -30), ahead).mean(), yard.look(Weather("w", -30), behind).mean()
    shine(beams, 0.0)
    assert on > 4 * back
    assert yard.look(Weather("w", -30), ahead).mean() == pytest.approx(back, rel=0.1)
