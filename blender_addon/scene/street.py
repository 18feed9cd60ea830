"""A small procedural street: road, markings, kerbs, pavements, grass, house fronts, trees and lamp posts.

Sky and ground realism hardly matter to detectors; silhouettes, shadows and clutter around the vehicle do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import seeding
from . import nodes
from .massing import MeshParts

ROAD_HALF_WIDTH_M = 5.0
PAVEMENT_WIDTH_M = 3.0
KERB_HEIGHT_M = 0.14
HOUSE_SETBACK_M = 19.0
STREET_HALF_LENGTH_M = 140.0
LOCATION_REACH_M = 90.0  # vehicles stand at least 50 m from the street's ends
LOCATION_STRIDE_M = 67.0  # does not divide the street, so locations spread over it before they come close


@dataclass(eq=False)
class Street:
    """The street's lamps (lights, switched by the weather) and where vehicles stand.

    Attributes:
        lamps: light objects.
        seed: names the street.
    """

    lamps: list[bpy.types.Object]
    seed: int

    def pose(self, location: int) -> NDArray[np.float64]:
        """(4, 4) vehicle-to-world transform of a location: along the road, either lane, a few degrees off its line."""
        rng = seeding.named_rng(self.seed, "location", location)
        x = (location * LOCATION_STRIDE_M) % (2 * LOCATION_REACH_M) - LOCATION_REACH_M + rng.uniform(-8, 8)
        side = 1 if rng.random() < 0.5 else -1
        heading = math.radians(rng.uniform(-8, 8)) + (0.0 if side < 0 else math.pi)
        pose = np.eye(4)
        pose[:2, :2] = [[math.cos(heading), -math.sin(heading)], [math.sin(heading), math.cos(heading)]]
        pose[:3, 3] = (x, side * rng.uniform(1.6, 2.6), 0.0)
        return pose

    def enter(self, location: int) -> None:
        """Nothing to change: the whole street is always there."""


def build_street(scene: bpy.types.Scene, seed: int) -> Street:
    """Add the street to the scene."""
    rng = seeding.named_rng(seed, "street")
    parts = MeshParts()
    _ground(parts)
    for side in (-1, 1):
        _houses(parts, rng, side)
        _trees(parts, rng, side)
    lamps = _lamp_posts(scene, parts)
    mesh = parts.to_mesh("rauca street", _materials())
    scene.collection.objects.link(bpy.data.objects.new("rauca street", mesh))
    return Street(lamps, seed)


def _ground(parts: MeshParts) -> None:
    length, road, outer = STREET_HALF_LENGTH_M, ROAD_HALF_WIDTH_M, ROAD_HALF_WIDTH_M + PAVEMENT_WIDTH_M
    parts.box("asphalt", (-length, -road, -0.3), (length, road, 0.0))
    parts.box("grass", (-400, -400, -0.6), (400, 400, -0.02))
    for side in (-1, 1):
        inner, far = sorted((side * (road + 0.15), side * outer))
        parts.box("pavement", (-length, inner, -0.3), (length, far, KERB_HEIGHT_M))
        inner, far = sorted((side * road, side * (road + 0.15)))
        parts.box("kerb", (-length, inner, -0.3), (length, far, KERB_HEIGHT_M + 0.01))
        inner, far = sorted((side * (road - 0.35), side * (road - 0.25)))
        parts.box("marking", (-length, inner, -0.1), (length, far, 0.004))
    for x in np.arange(-length, length, 9.0):
        parts.box("marking", (x, -0.06, -0.1), (x + 3.0, 0.06, 0.004))


def _houses(parts: MeshParts, rng: np.random.Generator, side: int) -> None:
    x = -STREET_HALF_LENGTH_M
    while x < STREET_HALF_LENGTH_M:
        width, depth, height = rng.uniform(9, 20), rng.uniform(9, 14), rng.uniform(6, 17)
        front = side * (HOUSE_SETBACK_M + rng.uniform(0, 3))
        low, high = sorted((front, front + side * depth))
        wall = f"wall{rng.integers(3)}"
        parts.box(wall, (x, low, 0.0), (x + width, high, height))
        if rng.random() < 0.6:
            parts.gable("roof", (x - 0.3, low - 0.3, height), (x + width + 0.3, high + 0.3, height + rng.uniform(2, 4)))
        x += width + (rng.uniform(2, 9) if rng.random() < 0.5 else 0.0)


def _trees(parts: MeshParts, rng: np.random.Generator, side: int) -> None:
    for x in np.arange(-STREET_HALF_LENGTH_M, STREET_HALF_LENGTH_M, 13.0):
        if rng.random() < 0.35:
            continue
        x = float(x + rng.uniform(-3, 3))
        y, height = side * rng.uniform(13.0, 16.0), rng.uniform(4.5, 8.0)
        parts.column("bark", (x, y, 0.0), 0.16, height * 0.6)
        for _ in range(4):
            offset = rng.normal(0, 0.75, 3)
            parts.blob("leaves", np.array([x, y, height * 0.75]) + offset, rng.uniform(1.0, 1.8), rng)


def _lamp_posts(scene: bpy.types.Scene, parts: MeshParts) -> list[bpy.types.Object]:
    lamps = []
    for i, x in enumerate(np.arange(-130.0, 131.0, 20.0)):
        side = 1 if i % 2 else -1
        foot, head = side * (ROAD_HALF_WIDTH_M + 2.4), side * (ROAD_HALF_WIDTH_M + 0.6)
        parts.column("metal", (float(x), foot, 0.0), 0.07, 6.4)
        low, high = sorted((foot, head))
        parts.box("metal", (x - 0.06, low, 6.3), (x + 0.06, high, 6.42))
        light = bpy.data.lights.new("rauca lamp", "SPOT")
        light.energy, light.color, light.spot_size, light.shadow_soft_size = 260.0, (1.0, 0.78, 0.52), 2.5, 0.15
        lamp = bpy.data.objects.new("rauca lamp", light)
        lamp.location = (float(x), head, 6.25)  # a spot light looks down its -z already
        lamp.hide_render = True
        scene.collection.objects.link(lamp)
        lamps.append(lamp)
    return lamps


def _materials() -> dict[str, bpy.types.Material]:
    return {
        "asphalt": _mottled("asphalt", (0.055, 0.055, 0.058), 0.35, 6.0, 0.85),
        "pavement": _mottled("pavement", (0.22, 0.21, 0.20), 0.25, 2.0, 0.9),
        "kerb": _mottled("kerb", (0.30, 0.30, 0.29), 0.15, 1.0, 0.9),
        "marking": _mottled("marking", (0.55, 0.55, 0.53), 0.2, 3.0, 0.7),
        "grass": _mottled("grass", (0.045, 0.075, 0.022), 0.6, 0.4, 1.0),
        "wall0": _facade("wall0", (0.36, 0.30, 0.24)),
        "wall1": _facade("wall1", (0.42, 0.40, 0.37)),
        "wall2": _facade("wall2", (0.24, 0.11, 0.075)),
        "roof": _mottled("roof", (0.12, 0.06, 0.045), 0.3, 1.0, 0.9),
        "bark": _mottled("bark", (0.06, 0.045, 0.03), 0.3, 5.0, 1.0),
        "leaves": _mottled("leaves", (0.04, 0.07, 0.018), 0.7, 3.0, 0.9),
        "metal": _mottled("metal", (0.10, 0.10, 0.11), 0.1, 1.0, 0.5),
    }


def _mottled(
    name: str, albedo: tuple[float, float, float], contrast: float, scale: float, roughness: float
) -> bpy.types.Material:
    """A rough surface whose linear albedo varies by +-contrast with noise of ``scale`` per metre."""
    material = bpy.data.materials.new(f"rauca {name}")
    tree = nodes.fresh_tree(material)
    place = nodes.add(tree, "ShaderNodeNewGeometry").outputs["Position"]
    noise = nodes.add(tree, "ShaderNodeTexNoise", Vector=place, Scale=scale, Detail=4.0)
    dark = (*(c * (1 - contrast) for c in albedo), 1.0)
    light = (*(c * (1 + contrast) for c in albedo), 1.0)
    colour = nodes.mix_colour(tree, noise.outputs[0], dark, light)
    shader = nodes.add(tree, "ShaderNodeBsdfPrincipled", Base_Color=colour, Roughness=roughness)
    nodes.output(tree, Surface=shader.outputs[0])
    return material


def _facade(name: str, albedo: tuple[float, float, float]) -> bpy.types.Material:
    """A wall with rows of dark windows: the pattern's bricks are the panes, its mortar the wall. UVs in metres."""
    material = bpy.data.materials.new(f"rauca {name}")
    tree = nodes.fresh_tree(material)
    uv = tree.nodes.new("ShaderNodeUVMap")
    pane = (0.02, 0.025, 0.03, 1.0)
    windows = nodes.add(
        tree,
        "ShaderNodeTexBrick",
        Vector=uv.outputs[0],
        Color1=pane,
        Color2=(0.05, 0.06, 0.07, 1.0),
        Mortar=(*albedo, 1.0),
        Scale=1.0,
        Mortar_Size=0.72,
        Mortar_Smooth=0.0,
        Brick_Width=2.6,
        Row_Height=3.0,
    )
    windows.offset = 0.0
    shader = nodes.add(tree, "ShaderNodeBsdfPrincipled", Base_Color=windows.outputs["Color"], Roughness=0.8)
    nodes.output(tree, Surface=shader.outputs[0])
    return material
