"""The paint: one color, or a UV map, wherever the paint mask allows.

The color goes into the base color of a non-metallic Principled BSDF under an untinted coat. Linear radiance is then
affine in it, which is what the light maps of a frame rest on.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract
from . import nodes
from .images import mask_image, srgb_image

UV_LAYER = "rauca"


def finish_inputs(spec: contract.Material, name: str) -> dict[str, Any]:
    """Inputs of a Principled BSDF for a paint material in the finish of that name; raises as ``finish_of``."""
    finish = contract.finish_of(spec, name)
    return {
        "Roughness": finish.roughness,
        "Specular_IOR_Level": finish.specular,
        "Coat_Weight": finish.coat,
        "Coat_Roughness": finish.coat_roughness,
    }


class Paint:
    """Color and UV map shared by all paint materials of one vehicle."""

    def __init__(self, vehicle: contract.Vehicle) -> None:
        self._mask = mask_image(vehicle.paint_mask)
        self._base: bpy.types.Image | None = None
        if vehicle.base_texture is not None:
            self._base = srgb_image("rauca base", vehicle.base_texture)
        self._map: bpy.types.Image | None = None
        self._trees: list[bpy.types.NodeTree] = []

    def set_color(self, linear: tuple[float, float, float]) -> None:
        """Paint in one linear RGB albedo."""
        for tree in self._trees:
            tree.nodes["paint color"].outputs[0].default_value = (*linear, 1.0)
            nodes.set_number(tree, "paint source", 0.0)

    def set_map(self, uv_map_srgb: NDArray[np.uint8]) -> None:
        """Paint with a UV map, (H, W, 3) 8-bit sRGB, row 0 at the top.

        It becomes a float image in linear light, so Cycles interpolates texels as the renderer's taps do. Cycles keeps
        stale pixels when an image is edited in place: each map is a new image.
        """
        previous = self._map
        self._map = srgb_image("rauca camouflage", uv_map_srgb)
        for tree in self._trees:
            tree.nodes["paint map"].image = self._map
            nodes.set_number(tree, "paint source", 1.0)
        if previous is not None:
            bpy.data.images.remove(previous)

    def pack(self) -> None:
        """Keep the images inside the .blend: they have no file of their own."""
        for image in (self._mask, self._base, self._map):
            if image is not None:
                image.pack()

    def connect(self, tree: bpy.types.NodeTree, unpainted: Any) -> bpy.types.NodeSocket:
        """Add the paint's nodes to ``tree``; returns the base color, ``unpainted`` where the mask is black."""
        flat = nodes.add(tree, "ShaderNodeRGB")
        uv_map = nodes.texture(tree, self._map, UV_LAYER)
        flat.name, uv_map.name = "paint color", "paint map"
        source = nodes.number(tree, "paint source")
        painted = nodes.mix_color(tree, source, flat.outputs[0], uv_map.outputs["Color"])
        self._trees.append(tree)
        return nodes.mix_color(tree, self.mask_socket(tree), unpainted, painted)

    def mask_socket(self, tree: bpy.types.NodeTree) -> bpy.types.NodeSocket:
        """The paint mask in [0, 1], interpolated as the renderer does."""
        return nodes.texture(tree, self._mask, UV_LAYER).outputs["Color"]

    def below(self, tree: bpy.types.NodeTree, spec: contract.Material) -> Any:
        """A material's color without paint: the vehicle's own texture, linear, or one color."""
        if spec.textured:
            return nodes.texture(tree, self._base, UV_LAYER).outputs["Color"]
        return (*spec.base_color, 1.0)
