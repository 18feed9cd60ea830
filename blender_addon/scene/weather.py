"""A contract weather in the scene: sky, exposure, fog, lamps and water.

Fog is a box of scattering medium over the ground; not the World's volume, which would hide the sky. Fog that thins out
with height is one volume of varying density, marched through in steps. Measured at extinction 0.03/m, falloff 2, 16
samples: that is four times as cheap as tracking collisions in it, with 1 dB less noise and a mean within 0.4 %.
Homogeneous slabs stacked to the same optical depth cost twice as much with three of them, and with six lose a tenth of
the light to the limit on bounces. In uniform fog, tracking is the better of the two.
"""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from .. import compat
from ..core import contract
from . import nodes
from .massing import BOX_FACES
from .sky import draw_sky, film_exposure, new_world
from .wetness import set_wetness


class SceneWeather:
    """The world, the fog, the street's lamps and the water on surfaces, set from a contract weather.

    Attributes:
        fog: the box of fog, hidden when there is none; it stands on the ground at its own origin.
    """

    def __init__(self, scene: bpy.types.Scene, lamps: list[bpy.types.Object]) -> None:
        self._scene = scene
        self._lamps = lamps  # the place's own list, which it may fill anew at each location
        self._world = new_world()
        self._drawn: tuple[float, ...] | None = None
        scene.world = self._world
        self.fog = new_fog_box()
        self.fog.hide_render = True
        scene.collection.objects.link(self.fog)
        scene.cycles.volume_step_rate = MARCH_RATE

    def apply(self, weather: contract.Weather) -> None:
        """Set everything; equal :meth:`contract.Weather.light_key` give equal renders."""
        if weather.sky_key() != self._drawn:  # Cycles works every newly drawn sky out, for 0.7 CPU seconds
            self._drawn = None  # until it is drawn: an exception on the way leaves it between two
            draw_sky(self._world, weather)
            self._drawn = weather.sky_key()
        self._scene.cycles.film_exposure = film_exposure(weather)
        shine(self._lamps, weather.lamps)
        self.fog.hide_render = weather.extinction == 0.0
        compat.march_volumes(self._scene, not weather.fog_is_uniform)
        fill_with_fog(self.fog, weather)
        set_wetness(weather.film, weather.puddles, weather.ripples)


HALF_WIDTH_M = 300.0
ANISOTROPY = 0.5  # forward scattering of droplets, tempered as multiple scattering evens it out
MARCH_RATE = 0.2  # of Cycles' default step, a tenth of the box; only fog that varies is marched through
SHAPE = ("extinction", "fog_falloff", "fog_distance")  # of fog that varies
CLEARING_EDGE = 0.1  # share of fog_distance over which fog sets in


def new_fog_box() -> bpy.types.Object:
    """The layer's box with a material of its own, in no scene yet."""
    sides, heights = (-HALF_WIDTH_M, HALF_WIDTH_M), (-0.5, contract.weather.FOG_TOP_M)
    mesh = bpy.data.meshes.new("rauca fog")
    mesh.from_pydata([(x, y, z) for z in heights for y in sides for x in sides], [], BOX_FACES)
    mesh.materials.append(bpy.data.materials.new("rauca fog"))
    return bpy.data.objects.new("rauca fog", mesh)


def fill_with_fog(box: bpy.types.Object, weather: contract.Weather) -> None:
    """Give a box the weather's fog; its nodes are built anew only when fog turns from uniform to shaped or back."""
    material = box.data.materials[0]
    tree = material.node_tree
    if weather.fog_is_uniform:
        if tree is None or "fog" not in tree.nodes or "fog_falloff" in tree.nodes:
            _scatter(nodes.fresh_tree(material), 0.0)
        material.node_tree.nodes["fog"].inputs["Density"].default_value = weather.extinction
        return
    if tree is None or "fog_falloff" not in tree.nodes:
        _build_shaped_fog(nodes.fresh_tree(material))
    for name in SHAPE:
        nodes.set_number(material.node_tree, name, getattr(weather, name))


def _build_shaped_fog(tree: bpy.types.NodeTree) -> None:
    numbers = {name: nodes.number(tree, name) for name in SHAPE}
    position = nodes.add(tree, "ShaderNodeTexCoord").outputs["Object"]  # the box stands on the ground
    height = nodes.add(tree, "ShaderNodeSeparateXYZ", Vector=position).outputs["Z"]
    above = nodes.compute(tree, "MAXIMUM", height, 0.0)
    halvings = nodes.compute(tree, "MULTIPLY", nodes.compute(tree, "MULTIPLY", above, numbers["fog_falloff"]), -0.1)
    thinned = nodes.compute(tree, "MULTIPLY", nodes.compute(tree, "POWER", 2.0, halvings), numbers["extinction"])
    away = nodes.add(tree, "ShaderNodeCameraData").outputs["View Distance"]
    beyond = nodes.compute(tree, "SUBTRACT", away, numbers["fog_distance"])
    edge = nodes.compute(tree, "MULTIPLY_ADD", numbers["fog_distance"], CLEARING_EDGE, 1e-3)
    set_in = nodes.compute(tree, "DIVIDE", beyond, edge, clamp=True)
    _scatter(tree, nodes.compute(tree, "MULTIPLY", thinned, set_in))


def _scatter(tree: bpy.types.NodeTree, density: bpy.types.NodeSocket | float) -> None:
    volume = nodes.add(tree, "ShaderNodeVolumeScatter", Density=density, Anisotropy=ANISOTROPY)
    volume.name = "fog"
    nodes.output(tree, Volume=volume.outputs[0])


# A low beam: three times a street lamp's intensity, aimed at the road some fifteen metres ahead.
BEAM_ENERGY_W = 800.0
BEAM_COLOR = (1.0, 0.93, 0.82)
BEAM_ANGLE_DEG, BEAM_BLEND, BEAM_DIP_DEG = 50.0, 0.9, 2.5
BEAM_SOURCE_RADIUS_M = 0.06
FULL_ENERGY = "rauca_full_energy"
BEAM_OFFSET_M = 0.08  # before the lens, so that the lamp's own housing does not swallow the light


def shine(lamps: list[bpy.types.Object], level: float) -> None:
    """Turn light objects to ``level``, 0 (off) to 1; the energy they come with is full brightness."""
    for lamp in lamps:
        # In the viewport too: by day the outlines of their cones would lie over everything.
        lamp.hide_render = lamp.hide_viewport = level == 0.0
        if FULL_ENERGY not in lamp.data:  # kept on the light itself, which lamps may share
            lamp.data[FULL_ENERGY] = lamp.data.energy
        lamp.data.energy = lamp.data[FULL_ENERGY] * level


def add_beams(
    scene: bpy.types.Scene, vehicle_object: bpy.types.Object, vehicle: contract.Vehicle
) -> list[bpy.types.Object]:
    """Beams of the headlamps, off, parented to the vehicle; the glow of the lenses is the vehicle's own.

    A vehicle without a material of kind ``headlamp`` has none.
    """
    beams = []
    for position in headlamp_positions(vehicle):
        light = bpy.data.lights.new("rauca headlamp", "SPOT")
        light.energy, light.color, light.shadow_soft_size = BEAM_ENERGY_W, BEAM_COLOR, BEAM_SOURCE_RADIUS_M
        light.spot_size, light.spot_blend = math.radians(BEAM_ANGLE_DEG), BEAM_BLEND
        beam = bpy.data.objects.new("rauca headlamp", light)
        beam.parent = vehicle_object
        beam.location = position
        dip = math.radians(BEAM_DIP_DEG)
        ahead = Vector((math.cos(dip), 0.0, -math.sin(dip)))
        beam.rotation_euler = ahead.to_track_quat("-Z", "Y").to_euler()
        beam.hide_render = True
        scene.collection.objects.link(beam)
        beams.append(beam)
    return beams


def headlamp_positions(vehicle: contract.Vehicle) -> NDArray[np.float64]:
    """Where beams start, (N, 3) metres in the vehicle's frame: before each side's headlamp glass; N is 0 to 2."""
    lenses = [i for i, material in enumerate(vehicle.materials) if material.kind == "headlamp"]
    faces = np.isin(vehicle.material, lenses)
    centers = vehicle.positions[vehicle.triangles[faces]].mean(axis=1).astype(np.float64)
    starts = []
    for side in (centers[:, 1] > 0, centers[:, 1] <= 0):
        if side.any():
            lens = centers[side]
            starts.append((lens[:, 0].max() + BEAM_OFFSET_M, lens[:, 1].mean(), lens[:, 2].mean()))
    return np.array(starts, np.float64).reshape(-1, 3)
