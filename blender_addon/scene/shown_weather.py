"""A weather in the artist's own scene, for looking at it, and its removal without a trace.

Cycles shows the sky, sun, clouds and fog that the data set's frames have. EEVEE knows no sun in a sky and no exposure
of the film, so it gets a sun lamp and a sky exposed beforehand: an approximation.

Rain is a picture laid over the viewport, drawn by the code that draws it into the data set's frames; what stands before
the drops is not known here, so they fall before everything.
"""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from ..core import contract, seeding
from . import nodes, wetness
from .overrides import Setting, override, restore
from .sky import DAY_CARD, GREY_CARD, draw_sky, film_exposure, new_world, sun_diameter_deg, sun_share, toward_sun
from .town.materials import NIGHT_GROUP, set_lit
from .weather import MARCH_RATE, fill_with_fog, new_fog_box, shine

EEVEE_FOG_END_M = 400.0
GROUND_RADIUS_M, GROUND_CORNERS = 2000.0, 64
GROUND_BELOW_M = 0.01  # under the wheels, so that an artist's own ground hides it
LOWEST_SUN = math.sin(math.radians(4.0))  # a grazing sun lamp would need endless strength


def show(
    scene: bpy.types.Scene,
    shown: bpy.types.PropertyGroup,
    asked: contract.Weather,
    lamps: list[bpy.types.Object],
    ground: NDArray[np.float64],
    turn_deg: float = 0.0,
) -> None:
    """Put a weather into the scene, or change the one that is there.

    Args:
        shown: where the scene keeps what was added (``world``, ``fog``, ``sun``), what that replaced (``world_before``,
            ``overrides``), and whether a weather is ``on``.
        lamps: street lamps, turned up after dark.
        ground: (3,) the point under the vehicle, metres, where fog lies.
        turn_deg: how far the street stands turned from where the data set has it; the sun turns with it.
    """
    turned = contract.Weather(**{**asked.to_json(), "sun_azimuth_angle": asked.sun_azimuth_angle + turn_deg})
    _add_missing(scene, shown)
    world, box = shown.world, shown.fog
    if scene.world != world:
        shown.world_before, scene.world = scene.world, world
    draw_sky(world, turned)
    _expose_for_eevee(world.node_tree, film_exposure(turned))
    fill_with_fog(box, turned)
    box.location = ground
    shown.ground.location = ground - (0.0, 0.0, GROUND_BELOW_M)
    box.hide_render = box.hide_viewport = turned.extinction == 0.0
    _aim_sun(shown.sun, turned)
    settings: dict[str, Setting] = {  # what Cycles and the display need to show it as the data set's frames have it
        "cycles.film_exposure": film_exposure(turned),
        "cycles.volume_step_rate": MARCH_RATE,
        "cycles.volume_biased": not turned.fog_is_uniform,
        "cycles.volume_bounces": 2,
        "eevee.volumetric_end": EEVEE_FOG_END_M,
        "view_settings.view_transform": "Standard",
        "view_settings.look": "None",
        "view_settings.exposure": 0.0,
        "view_settings.gamma": 1.0,
    }
    shown.overrides = override(scene, shown.overrides, settings)
    _wet_and_light(lamps, turned.lamps, turned.film, turned.puddles, turned.ripples)
    shown.on = True


def remove(scene: bpy.types.Scene, shown: bpy.types.PropertyGroup, lamps: list[bpy.types.Object]) -> None:
    """Take the weather out: the artist's world and settings are back, what was added is gone."""
    restore(scene, shown.overrides)
    if scene.world == shown.world:
        scene.world = shown.world_before
    _wet_and_light(lamps, 0.0, 0.0, 0.0, 0.0)
    added = [shown.world, shown.fog, shown.sun, shown.ground]
    for thing in (shown.fog, shown.sun, shown.ground):
        if thing is not None:
            added += [thing.data, *getattr(thing.data, "materials", ())]
    shown.world = shown.world_before = shown.fog = shown.sun = shown.ground = None
    shown.overrides, shown.on = "", False
    bpy.data.batch_remove([block for block in added if block is not None])


def _wet_and_light(lamps: list[bpy.types.Object], level: float, film: float, puddles: float, ripples: float) -> None:
    """Both node groups serve all scenes; without one, nothing here can get wet or be lit."""
    shine(lamps, level)
    if wetness.GROUP in bpy.data.node_groups:
        wetness.set_wetness(film, puddles, ripples)
    if NIGHT_GROUP in bpy.data.node_groups:
        set_lit(level)


def _add_missing(scene: bpy.types.Scene, shown: bpy.types.PropertyGroup) -> None:
    """Add the world, the fog's box, EEVEE's sun and the ground; an artist may have deleted one."""
    if shown.world is None:
        shown.world = new_world()
    if shown.fog is None:
        shown.fog = new_fog_box()
        shown.fog.display_type = "BOUNDS"  # else it would hide the scene in the solid view
        shown.fog.hide_select = True
    if shown.sun is None:
        light = bpy.data.lights.new("rauca sun", "SUN")
        # Cycles follows a light's nodes, EEVEE does not: nodes that emit nothing leave the lamp to EEVEE.
        light.use_nodes = True
        emission = next(node for node in light.node_tree.nodes if node.type == "EMISSION")
        emission.inputs["Strength"].default_value = 0.0
        shown.sun = bpy.data.objects.new("rauca sun", light)
        shown.sun.hide_select = True
    if shown.ground is None:
        shown.ground = _new_ground()
    for thing in (shown.fog, shown.sun, shown.ground):
        if thing.name not in scene.objects:
            scene.collection.objects.link(thing)


def _new_ground() -> bpy.types.Object:
    """A grey disc out to the horizon: without it the sky's lower half, which is black, shows around the vehicle."""
    turns = np.linspace(0.0, 2.0 * math.pi, GROUND_CORNERS, endpoint=False)
    corners = [(GROUND_RADIUS_M * math.cos(turn), GROUND_RADIUS_M * math.sin(turn), 0.0) for turn in turns]
    mesh = bpy.data.meshes.new("rauca ground")
    mesh.from_pydata(corners, [], [list(range(GROUND_CORNERS))])
    material = bpy.data.materials.new("rauca ground")
    tree = nodes.fresh_tree(material)
    nodes.principled_surface(tree, Base_Color=(GREY_CARD, GREY_CARD, GREY_CARD, 1.0), Roughness=0.9)
    mesh.materials.append(material)
    thing = bpy.data.objects.new("rauca ground", mesh)
    thing.display_type, thing.hide_select = "BOUNDS", True  # else it would hide the grid in the solid view
    return thing


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
    direction = toward_sun(asked)
    sun.rotation_euler = Vector(direction).to_track_quat("Z", "Y").to_euler()
    direct = min(1.0, max(0.0, altitude / 20.0)) * 0.8 * sun_share(cover)  # share of the light on the ground
    sun.data.energy = direct * DAY_CARD * math.pi / GREY_CARD / max(direction[2], LOWEST_SUN)
    sun.data.angle = math.radians(sun_diameter_deg(cover))
    warm = min(1.0, max(0.0, 1.0 - altitude / 25.0))
    sun.data.color = (1.0, 1.0 - 0.25 * warm, 1.0 - 0.55 * warm)
    sun.hide_render = sun.hide_viewport = direct == 0.0


HEIGHT = 360  # pixels; enlarged to the viewport's
FOV_DEG = 60.0
DISTANCE_M = 12.0  # of everything, for the haze that distant drops make
LOOKING_DOWN_M = 0.3  # at that distance


def rain_picture(weather: contract.Weather, aspect: float) -> NDArray[np.float32] | None:
    """The rain before a view, (H, W, 4) linear, display-referred RGBA, not premultiplied; None in dry weather.

    Args:
        aspect: width over height of the view.
    """
    if weather.precipitation == 0.0:
        return None
    width = max(1, round(HEIGHT * aspect))
    eye, target = np.array([0.0, 0.0, 1.5]), np.array([DISTANCE_M, 0.0, 1.5 - LOOKING_DOWN_M])
    camera = contract.Camera.look_at(eye, target, FOV_DEG, width, HEIGHT)
    distance = np.full((HEIGHT, width), DISTANCE_M, np.float32)
    rain = contract.rain.streaks(weather, camera, distance, seeding.named_seed("viewport"))
    picture = np.empty((HEIGHT, width, 4), np.float32)
    picture[..., :3], picture[..., 3] = rain.radiance, rain.alpha
    return picture
