"""How far a bake is from the camouflage it carries, seen by cameras: the same renders with the one and the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import color, contract
from . import camera as cameras
from .coating import Coat
from .nodes import add, fresh_tree
from .render import prepare, render_linear
from .surface import Surface

FOV_DEG = 40.0
ELEVATION_DEG, DISTANCES = 12.0, (1.6, 3.2)  # distances in vehicle lengths
CHANGED = 1e-3  # of linear radiance: where the camouflage changes a pixel, there is paint


@dataclass(frozen=True)
class RoundTrip:
    """PSNR of display values, dB: over the pixels that show the vehicle, and over those that show its paint."""

    vehicle_db: float
    paint_db: float


def look_around(surface: Surface, size: int, azimuths: Sequence[float]) -> list[contract.Camera]:
    """Cameras around the vehicle where it stands, near and far, ``size`` pixels square; azimuths in degrees."""
    low, high = surface.soup.positions.min(axis=0), surface.soup.positions.max(axis=0)
    center, length = (low + high) / 2, float((high - low).max())
    up = np.radians(ELEVATION_DEG)
    views = []
    for distance in DISTANCES:
        for azimuth in np.radians(azimuths):
            toward = np.array([np.cos(up) * np.cos(azimuth), np.cos(up) * np.sin(azimuth), np.sin(up)])
            eye = center + toward * distance * length
            views.append(contract.Camera.look_at(eye, center, FOV_DEG, size, size))
    return views


def round_trip(scene: bpy.types.Scene, coat: Coat, views: Sequence[contract.Camera], samples: int = 16) -> RoundTrip:
    """Render ``scene`` with the camouflage and with its bake, same noise, and compare.

    The scene's lights and world are taken as they are; its camera, its engine's settings and what is shown change.
    """
    prepare(scene)
    scene.render.film_transparent = True
    quality = contract.Quality(samples, denoise=False)
    errors: list[NDArray[np.float64]] = []
    painted: list[NDArray[np.bool_]] = []
    for view in views:
        cameras.place(scene, view)
        shown = {}
        for which in ("ORIGINAL", "CAMOUFLAGE", "BAKED"):
            coat.show(which)
            shown[which] = render_linear(scene, quality, seed=1)
        there = shown["CAMOUFLAGE"][..., 3] > 0.5
        direct, baked = (color.linear_to_srgb(shown[w][..., :3][there]) for w in ("CAMOUFLAGE", "BAKED"))
        changed = np.abs(shown["CAMOUFLAGE"] - shown["ORIGINAL"])[..., :3].max(axis=2) > CHANGED
        errors.append(((direct - baked).astype(np.float64) ** 2).mean(axis=1))
        painted.append(changed[there])
    error, paint = np.concatenate(errors), np.concatenate(painted)
    return RoundTrip(_psnr(error), _psnr(error[paint]))


def daylight(scene: bpy.types.Scene) -> None:
    """A sun and a bright sky of one color: light that shows every texel alike."""
    sun = bpy.data.objects.new("rauca sun", bpy.data.lights.new("rauca sun", "SUN"))
    sun.data.energy = 2.0
    sun.rotation_euler = (0.6, 0.3, 0.0)
    scene.collection.objects.link(sun)
    world = scene.world = bpy.data.worlds.new("rauca sky")
    tree = fresh_tree(world)
    sky = add(tree, "ShaderNodeBackground", Color=(0.7, 0.8, 1.0, 1.0), Strength=0.8)
    add(tree, "ShaderNodeOutputWorld", Surface=sky.outputs[0])


def _psnr(squared: NDArray[np.float64]) -> float:
    return float(-10 * np.log10(max(float(squared.mean()), 1e-12))) if len(squared) else float("nan")
