"""Coverage and distance of every pixel, from a render in which nothing but geometry is left.

Every material is exchanged for an emitter whose red is "vehicle", green "paint", blue the distance to the camera; no
light bounces and there is no fog, so a pixel's value is exactly the renderer's own anti-aliased coverage.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import colour, contract
from . import nodes
from .render import render_linear
from .vehicle import SceneVehicle

SAMPLES = 64
FAR_M = 5000.0


@dataclass(eq=False)
class Annotation:
    """Coverage of the vehicle and of its paint in [0, 1], and distance along the view ray in metres (infinity: sky).

    Kept as (H, W) uint8, uint8 and float16: a location's worth of them waits in memory for its weathers.
    """

    vehicle: NDArray[np.uint8]
    paint: NDArray[np.uint8]
    distance: NDArray[np.float16]

    def box_xyxy(self) -> tuple[float, float, float, float] | None:
        """The tight box of pixels at least half covered by the vehicle; None when fewer than 16 are."""
        rows, columns = np.nonzero(self.vehicle >= 128)
        if rows.size < 16:
            return None
        return float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1)


def annotate(scene: bpy.types.Scene, seed: int) -> Annotation:
    """Render the scene's camera inside :func:`geometry_only`."""
    pixels = render_linear(scene, contract.Quality(SAMPLES, denoise=False, bounces=0), seed)
    solid = pixels[..., 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.where(solid > 0.5, pixels[..., 2] / solid, np.inf)
    return Annotation(
        vehicle=colour.to_bytes(pixels[..., 0]),
        paint=colour.to_bytes(pixels[..., 1]),
        distance=distance.astype(np.float16),
    )


@contextlib.contextmanager
def geometry_only(scene: bpy.types.Scene, vehicle: SceneVehicle, fog: list[bpy.types.Object]) -> Iterator[None]:
    """Within: surfaces emit their annotation, the sky is transparent, light and fog are off. After: all as before."""
    background = _emitter("rauca background", 0.0, None)
    other = _emitter("rauca vehicle", 1.0, None)
    painted = _emitter("rauca paint", 1.0, vehicle)
    slots = [(slot, slot.material) for thing in scene.objects if thing.type == "MESH" for slot in thing.material_slots]
    cycles, render = scene.cycles, scene.render
    before = cycles.max_bounces, cycles.film_exposure, render.film_transparent, scene.world
    hidden = [(thing, thing.hide_render) for thing in [*fog, *(o for o in scene.objects if o.type == "LIGHT")]]
    try:
        for slot, material in slots:
            if slot.id_data == vehicle.object:
                slot.material = painted if _is_paint(vehicle, material) else other
            else:
                slot.material = background
        for thing, _ in hidden:
            thing.hide_render = True
        cycles.max_bounces, cycles.film_exposure, render.film_transparent, scene.world = 0, 1.0, True, None
        yield
    finally:
        for slot, material in slots:
            slot.material = material
        for thing, was in hidden:
            thing.hide_render = was
        cycles.max_bounces, cycles.film_exposure, render.film_transparent, scene.world = before
        for material in (background, other, painted):
            bpy.data.materials.remove(material)


def _is_paint(vehicle: SceneVehicle, material: bpy.types.Material) -> bool:
    return vehicle.vehicle.materials[vehicle.materials.index(material)].kind == "paint"


def _emitter(name: str, vehicle: float, paint: SceneVehicle | None) -> bpy.types.Material:
    material = bpy.data.materials.new(name)
    material.cycles.emission_sampling = "NONE"
    tree = nodes.fresh_tree(material)
    channels = nodes.add(tree, "ShaderNodeCombineXYZ", X=vehicle, Y=0.0)
    tree.links.new(nodes.add(tree, "ShaderNodeCameraData").outputs["View Distance"], channels.inputs["Z"])
    if paint is not None:
        tree.links.new(paint.paint.mask_socket(tree), channels.inputs["Y"])
    nodes.output(tree, Surface=nodes.add(tree, "ShaderNodeEmission", Color=channels.outputs[0]).outputs[0])
    return material
