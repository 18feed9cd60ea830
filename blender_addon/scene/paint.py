"""The paint: one color, or a UV map, wherever the paint mask allows.

The color goes into the base color of a non-metallic Principled BSDF under an untinted coat. Linear radiance is then
affine in it, which is what the light maps of a frame rest on.
"""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import color, contract
from . import nodes
from .wetness import wet


@dataclass(frozen=True)
class Finish:
    """Inputs of a Principled BSDF that shape the paint's reflections.

    Attributes:
        roughness: of the colored surface.
        specular: its ``Specular IOR Level``; 0.5 reflects 4 % head-on, as plastic against air.
        coat, coat_roughness: weight and roughness of the clear layer on top, refractive index 1.5.
    """

    roughness: float
    specular: float
    coat: float
    coat_roughness: float


FINISHES = {
    # Solid color under clearcoat. The lacquer covers all of it (coat 1) and is polished: the sun's image in it is
    # sharp (roughness 0.03, Blender's own for a coat). Binder and lacquer have nearly one refractive index, so the
    # colored layer itself has only a faint, wide gloss left (specular 0.1, roughness 0.5).
    "car_paint": Finish(roughness=0.5, specular=0.1, coat=1.0, coat_roughness=0.03),
    # Printed matte vinyl wrap: no lacquer; a matte film keeps under a tenth of a polished surface's gloss at 60
    # degrees, which takes a roughness about 0.7; its structured face also halves the mirror-like part.
    "sticker": Finish(roughness=0.7, specular=0.25, coat=0.0, coat_roughness=0.03),
}


def finish_of(spec: contract.Material, name: str) -> Finish:
    """The finish of a paint material: its own numbers for ``own``, else those of ``car_paint`` or ``sticker``.

    Raises:
        RaucaError: there is no finish of that name.
    """
    if name == "own":
        return Finish(spec.roughness, 0.5, spec.coat, 0.03)
    if name not in FINISHES:
        raise contract.RaucaError(f"finish must be one of own, {', '.join(FINISHES)}, not {name!r}")
    return FINISHES[name]


UV_LAYER = "rauca"


class Paint:
    """Color and UV map shared by all paint materials of one vehicle."""

    def __init__(self, vehicle: contract.Vehicle) -> None:
        mask = np.repeat(vehicle.paint_mask[:, :, None], 3, axis=2) / np.float32(255)
        self._mask = float_image("rauca paint mask", mask)
        self._base: bpy.types.Image | None = None
        if vehicle.base_texture is not None:
            self._base = float_image("rauca base", color.srgb_to_linear(vehicle.base_texture / np.float32(255)))
        self._map: bpy.types.Image | None = None
        self._trees: list[bpy.types.NodeTree] = []

    def set_color(self, linear: tuple[float, float, float]) -> None:
        """Paint in one linear RGB albedo."""
        for tree in self._trees:
            tree.nodes["paint color"].outputs[0].default_value = (*linear, 1.0)
            tree.nodes["paint source"].outputs[0].default_value = 0.0

    def set_map(self, uv_map_srgb: NDArray[np.uint8]) -> None:
        """Paint with a UV map, (H, W, 3) 8-bit sRGB, row 0 at the top.

        It becomes a float image in linear light, so Cycles interpolates texels as the renderer's taps do. Cycles keeps
        stale pixels when an image is edited in place: each map is a new image.
        """
        previous = self._map
        self._map = float_image("rauca camouflage", color.srgb_to_linear(uv_map_srgb / np.float32(255)))
        for tree in self._trees:
            tree.nodes["paint map"].image = self._map
            tree.nodes["paint source"].outputs[0].default_value = 1.0
        if previous is not None:
            bpy.data.images.remove(previous)

    def pack(self) -> None:
        """Keep the images inside the .blend: they have no file of their own."""
        for image in (self._mask, self._base, self._map):
            if image is not None:
                image.pack()

    def connect(
        self, tree: bpy.types.NodeTree, unpainted: bpy.types.NodeSocket | tuple[float, ...]
    ) -> bpy.types.NodeSocket:
        """Add the paint's nodes to ``tree``; returns the base color, ``unpainted`` where the mask is black."""
        flat = nodes.add(tree, "ShaderNodeRGB")
        source = nodes.add(tree, "ShaderNodeValue")
        uv_map = self._texture(tree, self._map)
        flat.name, source.name, uv_map.name = "paint color", "paint source", "paint map"
        source.outputs[0].default_value = 0.0
        painted = nodes.mix_color(tree, source.outputs[0], flat.outputs[0], uv_map.outputs["Color"])
        self._trees.append(tree)
        return nodes.mix_color(tree, self.mask_socket(tree), unpainted, painted)

    def mask_socket(self, tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
        """The paint mask in [0, 1], interpolated as the renderer does."""
        return self._texture(tree, self._mask).outputs["Color"]

    def base_texture_socket(self, tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
        """The vehicle's original texture, linear."""
        return self._texture(tree, self._base).outputs["Color"]

    @staticmethod
    def _texture(tree: bpy.types.NodeTree, image: bpy.types.Image | None) -> bpy.types.Node:
        uv = tree.nodes.new("ShaderNodeUVMap")
        uv.uv_map = UV_LAYER
        texture = nodes.add(tree, "ShaderNodeTexImage", Vector=uv.outputs[0])
        texture.image, texture.interpolation, texture.extension = image, "Linear", "EXTEND"
        return texture


def paint_material(spec: contract.Material, paint: Paint, finish: str = "own") -> bpy.types.Material:
    """The material of a painted part in a finish (see :data:`FINISHES`)."""
    material = bpy.data.materials.new(f"rauca {spec.name}")
    tree = nodes.fresh_tree(material)
    unpainted = paint.base_texture_socket(tree) if spec.textured else (*spec.base_color, 1.0)
    surface = finish_of(spec, finish)
    base, roughness = wet(tree, paint.connect(tree, unpainted), surface.roughness, porosity=0.0)
    shader = nodes.add(
        tree,
        "ShaderNodeBsdfPrincipled",
        Base_Color=base,
        Roughness=roughness,
        Metallic=0.0,  # a metallic base tints its highlights: radiance would no longer be affine in the color
        Specular_IOR_Level=surface.specular,
        Coat_Weight=surface.coat,
        Coat_Roughness=surface.coat_roughness,
    )
    nodes.output(tree, Surface=shader.outputs[0])
    return material


def float_image(name: str, linear: NDArray[np.float32]) -> bpy.types.Image:
    """A new image of (H, W, 3) linear values, row 0 at the top, which Blender interpolates as they are."""
    return image_of_pixels(name, blender_pixels(linear))


def blender_pixels(linear: NDArray[np.float32]) -> NDArray[np.float32]:
    """The same (H, W, 3) values as Blender keeps them: (H, W, 4), opaque, row 0 at the bottom."""
    pixels = np.ones((*linear.shape[:2], 4), np.float32)
    pixels[..., :3] = linear[::-1]
    return pixels


def image_of_pixels(name: str, pixels: NDArray[np.float32]) -> bpy.types.Image:
    """A new float image of :func:`blender_pixels`."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=True, is_data=True)
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    return image
