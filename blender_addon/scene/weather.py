"""Sun, sky, night lamps and fog for a contract weather."""

from __future__ import annotations

import math

import bpy
import numpy as np

from .. import compat
from ..core import contract
from . import nodes
from .massing import box_solid

FOG_TOP_M = 12.0
FOG_HALF_WIDTH_M = 300.0
FOG_ANISOTROPY = 0.5  # forward scattering of droplets, tempered as multiple scattering evens it out
NIGHT_SKY = (0.012, 0.016, 0.028)  # linear radiance after exposure: dark, not black, as CARLA's night
NIGHT_EXPOSURE = 2.5

# Film exposure per sun altitude (degrees) in powers of two: brings an 18 % grey card lying flat under this sky, without
# fog, to 0.2-0.3 of display white by day and 0.13 at sunset. `tests/blender/test_scene.py` measures it again.
EXPOSURE_STOPS = (
    *((0.0, 1.0), (2.0, 0.3), (5.0, -1.0), (10.0, -2.2), (20.0, -3.35)),
    *((30.0, -3.95), (45.0, -4.45), (60.0, -4.65), (90.0, -4.8)),
)


class SceneWeather:
    """The world, the fog box and the street's lamps, set from a contract weather."""

    def __init__(self, scene: bpy.types.Scene, lamps: list[bpy.types.Object]) -> None:
        self._scene = scene
        self._lamps = lamps
        self._world = bpy.data.worlds.new("rauca weather")
        scene.world = self._world
        self.fog = _fog_box(scene)

    def apply(self, weather: contract.Weather) -> None:
        """Set sun, sky, exposure, fog and lamps."""
        tree = nodes.fresh_tree(self._world)
        if weather.is_night:
            background = nodes.add(tree, "ShaderNodeBackground", Color=(*NIGHT_SKY, 1.0), Strength=1.0)
            self._scene.cycles.film_exposure = NIGHT_EXPOSURE
        else:
            sky = nodes.add(tree, "ShaderNodeTexSky")
            sky.sky_type = compat.sky_texture_kind()
            sky.sun_elevation = math.radians(weather.sun_altitude_angle)
            # Blender turns its sun clockwise from +y, CARLA's azimuth here counter-clockwise from +x.
            sky.sun_rotation = math.radians(90.0 - weather.sun_azimuth_angle)
            sky.sun_disc = True
            background = nodes.add(tree, "ShaderNodeBackground", Color=sky.outputs[0], Strength=1.0)
            self._scene.cycles.film_exposure = 2.0 ** exposure_stops(weather.sun_altitude_angle)
        tree.links.new(background.outputs[0], nodes.add(tree, "ShaderNodeOutputWorld").inputs["Surface"])
        for lamp in self._lamps:
            lamp.hide_render = not weather.is_night
        self.fog.hide_render = weather.extinction == 0.0
        density = self.fog.active_material.node_tree.nodes["fog"].inputs["Density"]
        density.default_value = weather.extinction


def exposure_stops(sun_altitude_deg: float) -> float:
    """Film exposure for a sun altitude in [0, 90] degrees, in powers of two."""
    altitudes, stops = zip(*EXPOSURE_STOPS, strict=True)
    return float(np.interp(sun_altitude_deg, altitudes, stops))


def _fog_box(scene: bpy.types.Scene) -> bpy.types.Object:
    """A box of homogeneous scattering medium over the ground; not the World's volume, which would hide the sky."""
    half = FOG_HALF_WIDTH_M
    corners, faces = box_solid((-half, -half, -0.5), (half, half, FOG_TOP_M))
    mesh = bpy.data.meshes.new("rauca fog")
    mesh.from_pydata(corners, [], faces)
    material = bpy.data.materials.new("rauca fog")
    tree = nodes.fresh_tree(material)
    volume = nodes.add(tree, "ShaderNodeVolumeScatter", Density=0.0, Anisotropy=FOG_ANISOTROPY)
    volume.name = "fog"
    nodes.output(tree, Volume=volume.outputs[0])
    mesh.materials.append(material)
    box = bpy.data.objects.new("rauca fog", mesh)
    box.hide_render = True
    scene.collection.objects.link(box)
    return box
