"""A weather in the artist's own scene, for looking at it, and its removal without a trace.

Cycles shows the sky, sun, clouds and fog that the data set's frames have. EEVEE knows no sun in a sky and no exposure
of the film, so it gets a sun lamp and a sky exposed beforehand: an approximation.
"""

from __future__ import annotations

import math
from typing import Protocol

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from ..core import contract
from . import clouds, fog, nodes, weather, wetness
from .lamps import StreetLamps
from .lent import Setting, give_back, lend
from .town import night

EEVEE_FOG_END_M = 400.0
LOWEST_SUN = math.sin(math.radians(4.0))  # a grazing sun lamp would need endless strength


class Shown(Protocol):
    """Where a scene keeps what was added to it and what it replaced; a property group.

    Attributes:
        on: True while a weather is shown.
        world, fog, sun: what was added; None before.
        world_before: the artist's own; None if there was none.
        loans: see `lent.py`.
    """

    on: bool
    world: bpy.types.World | None
    world_before: bpy.types.World | None
    fog: bpy.types.Object | None
    sun: bpy.types.Object | None
    loans: str


def show(
    scene: bpy.types.Scene,
    shown: Shown,
    asked: contract.Weather,
    lamps: list[bpy.types.Object],
    ground: NDArray[np.float64],
    turn_deg: float = 0.0,
) -> None:
    """Put a weather into the scene, or change the one that is there.

    Args:
        lamps: street lamps, turned up after dark.
        ground: (3,) the point under the vehicle, metres, where fog lies.
        turn_deg: how far the street stands turned from where the data set has it; the sun turns with it.
    """
    turned = contract.Weather(**{**asked.to_json(), "sun_azimuth_angle": asked.sun_azimuth_angle + turn_deg})
    world, box, sun = _added(scene, shown)
    if scene.world != world:
        shown.world_before, scene.world = scene.world, world
    weather.draw_sky(world, turned)
    _expose_for_eevee(world.node_tree, weather.film_exposure(turned))
    fog.fill(box, turned)
    box.location = ground
    box.hide_render = box.hide_viewport = turned.extinction == 0.0
    _aim_sun(sun, turned)
    shown.loans = lend(scene, shown.loans, _settings(turned))
    StreetLamps(lamps).shine(turned.lamps)
    # Both groups serve all scenes; without one, nothing here can get wet or be lit.
    if wetness.GROUP in bpy.data.node_groups:
        wetness.set_wetness(turned.film, turned.puddles, turned.ripples)
    if night.GROUP in bpy.data.node_groups:
        night.set_lit(turned.lamps)
    shown.on = True


def remove(scene: bpy.types.Scene, shown: Shown, lamps: list[bpy.types.Object]) -> None:
    """Take the weather out: the artist's world and settings are back, what was added is gone."""
    give_back(scene, shown.loans)
    if scene.world == shown.world:
        scene.world = shown.world_before
    StreetLamps(lamps).shine(0.0)
    if wetness.GROUP in bpy.data.node_groups:
        wetness.set_wetness(0.0, 0.0)
    if night.GROUP in bpy.data.node_groups:
        night.set_lit(0.0)
    added = [shown.world, shown.fog, shown.sun]
    for thing in (shown.fog, shown.sun):
        if thing is not None:
            added += [thing.data, *getattr(thing.data, "materials", ())]
    shown.world = shown.world_before = shown.fog = shown.sun = None
    shown.loans, shown.on = "", False
    bpy.data.batch_remove([block for block in added if block is not None])


def _settings(asked: contract.Weather) -> dict[str, Setting]:
    """What Cycles and the display need to show a weather as the data set's frames have it."""
    return {
        "cycles.film_exposure": weather.film_exposure(asked),
        "cycles.volume_step_rate": fog.MARCH_RATE,
        "cycles.volume_biased": not asked.fog_is_uniform,
        "cycles.volume_bounces": 2,
        "eevee.volumetric_end": EEVEE_FOG_END_M,
        "view_settings.view_transform": "Standard",
        "view_settings.look": "None",
        "view_settings.exposure": 0.0,
        "view_settings.gamma": 1.0,
    }


def _added(scene: bpy.types.Scene, shown: Shown) -> tuple[bpy.types.World, bpy.types.Object, bpy.types.Object]:
    """The world, the fog's box and EEVEE's sun; those that are missing are added: an artist may have deleted one."""
    if shown.world is None:
        shown.world = weather.new_world()
    if shown.fog is None:
        shown.fog = fog.new_box()
        shown.fog.display_type = "BOUNDS"  # else it would hide the scene in the solid view
        shown.fog.hide_select = True
    if shown.sun is None:
        light = bpy.data.lights.new("rauca sun", "SUN")
        _hide_from_cycles(light)
        shown.sun = bpy.data.objects.new("rauca sun", light)
        shown.sun.hide_select = True
    for thing in (shown.fog, shown.sun):
        if thing.name not in scene.objects:
            scene.collection.objects.link(thing)
    return shown.world, shown.fog, shown.sun


def _hide_from_cycles(light: bpy.types.Light) -> None:
    """Cycles follows a light's nodes, EEVEE does not: nodes that emit nothing leave the lamp to EEVEE."""
    light.use_nodes = True
    emission = next(node for node in light.node_tree.nodes if node.type == "EMISSION")
    emission.inputs["Strength"].default_value = 0.0


def _expose_for_eevee(tree: bpy.types.NodeTree, exposure: float) -> None:
    """A second output beside the sky's own, for EEVEE, as bright as Cycles' film makes it."""
    for_cycles = next(node for node in tree.nodes if node.type == "OUTPUT_WORLD")
    for_cycles.target = "CYCLES"
    sky = next(node for node in tree.nodes if node.type == "BACKGROUND")
    exposed = nodes.add(tree, "ShaderNodeBackground", Strength=exposure)
    if sky.inputs["Color"].is_linked:
        tree.links.new(sky.inputs["Color"].links[0].from_socket, exposed.inputs["Color"])
    else:
        exposed.inputs["Color"].default_value = sky.inputs["Color"].default_value
    for_eevee = nodes.add(tree, "ShaderNodeOutputWorld", Surface=exposed.outputs[0])
    for_eevee.target = "EEVEE"


def _aim_sun(sun: bpy.types.Object, asked: contract.Weather) -> None:
    """EEVEE's sun lights the grey card as strongly as the sky's sun does, within a fifth or so."""
    cover, altitude = asked.cloudiness / 100.0, asked.sun_altitude_angle
    up, around = math.radians(altitude), math.radians(asked.sun_azimuth_angle)
    direction = Vector((math.cos(up) * math.cos(around), math.cos(up) * math.sin(around), math.sin(up)))
    sun.rotation_euler = direction.to_track_quat("Z", "Y").to_euler()
    direct = min(1.0, max(0.0, altitude / 20.0)) * 0.8 * clouds.sun_share(cover)  # share of the light on the ground
    sun.data.energy = direct * weather.DAY_CARD * math.pi / clouds.GREY_CARD / max(math.sin(up), LOWEST_SUN)
    sun.data.angle = math.radians(clouds.sun_diameter_deg(cover))
    warm = min(1.0, max(0.0, 1.0 - altitude / 25.0))
    sun.data.color = (1.0, 1.0 - 0.25 * warm, 1.0 - 0.55 * warm)
    sun.hide_render = sun.hide_viewport = direct == 0.0
