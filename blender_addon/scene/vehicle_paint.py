"""What of an imported vehicle is paint, and how its materials look."""

from __future__ import annotations

import re
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import color, contract
from .images import image_linear, image_pixels, read_image_blender
from .vehicle_request import VehicleRequest

KINDS = [
    ("glass", r"glass|window|windscreen|windshield"),
    ("tyre", r"tyre|tire|rubber"),
    ("rim", r"rim\b|rims|wheel|alloy"),
    ("taillamp", r"(tail|rear|brake)[ _.-]?(light|lamp)"),
    ("headlamp", r"(head|front)[ _.-]?(light|lamp)"),
    ("plate", r"plate"),
    ("trim", r"trim|plastic|chrome|black"),
]


def choose_paint(names: list[str], request: VehicleRequest) -> list[str]:
    """Names of the painted materials: the one asked for, all when a mask decides, or the one whose name says so.

    Raises:
        RaucaError: an unknown name, or nothing to decide by.
    """
    shown, wanted = ", ".join(repr(n) if n else "(faces without a material)" for n in names), request.paint_material
    if wanted is not None:
        if wanted not in names:
            raise contract.RaucaError(f"{request.where}: has no material {wanted!r}; it has {shown}; {request.remedy}")
        return [wanted]
    if request.paint_mask is not None:
        return names
    for word in ("paint", "body", "car"):  # the clearest word first
        found = [n for n in names if word in n.lower()]
        if len(names) > 1 and len(found) == 1:
            return found
    raise contract.RaucaError(f"{request.where}: cannot tell which faces are paint; it has {shown}; {request.remedy}")


def read_mask(path: Path, base: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    """The user's paint mask, (H, H) uint8.

    Raises:
        RaucaError: not grey, not square, smaller than 64, not the base texture's size, or black.
    """
    mask = read_image_blender(path)
    if mask.ndim == 3:
        if np.ptp(mask.astype(np.int16), axis=2).max() > 2:
            raise contract.RaucaError(
                f"--paint-mask {path}: has colors; save it grey, white where the paint may change"
            )
        mask = np.ascontiguousarray(mask[..., 0])
    height, width = mask.shape
    if base is not None and base.shape[0] == base.shape[1] and mask.shape != base.shape[:2]:
        raise contract.RaucaError(
            f"--paint-mask {path}: is {width}x{height}, the texture {base.shape[1]}x{base.shape[0]}; resize it"
        )
    if height != width or height < 64:
        raise contract.RaucaError(f"--paint-mask {path}: is {width}x{height}; it must be square and at least 64x64")
    if not (mask >= 128).any():
        raise contract.RaucaError(f"--paint-mask {path}: is black; paint white where the camouflage may go")
    return mask


def base_image(material: bpy.types.Material | None, beside: Path | None) -> NDArray[np.uint8] | None:
    """The texture of a material's base color, (H, W, 3) sRGB; without one, the PNG ``beside`` the vehicle's file."""
    image = linked_image(material)
    if image is not None and image.size[0] and image.size[1]:
        if image.is_float:  # Blender keeps these in linear light, whatever their file holds
            return color.to_bytes(color.linear_to_srgb(image_linear(image)))
        pixels = image_pixels(image)
    elif beside is not None and beside.is_file():
        pixels = read_image_blender(beside)
    else:
        return None
    return pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, axis=2)


def describe(
    name: str, material: bpy.types.Material | None, paint: bool, base: NDArray[np.uint8] | None
) -> contract.Material:
    """The contract's material; ``base`` is its texture, of which it keeps the mean color."""
    kind = "paint" if paint else next((k for k, words in KINDS if re.search(words, name, re.IGNORECASE)), "other")
    shader = _principled(material)
    rgb, roughness, metallic, coat = np.full(3, 0.5), 0.4, 0.0, 0.0
    if shader is not None:
        rgb = np.clip(shader.inputs["Base Color"].default_value[:3], 0, 1)
        roughness, metallic, coat = (
            float(np.clip(shader.inputs[key].default_value, 0, 1)) for key in ("Roughness", "Metallic", "Coat Weight")
        )
    if base is not None:
        linear = color.srgb_to_linear(base[:: max(1, len(base) // 256), :: max(1, len(base) // 256)] / 255.0)
        rgb = linear.reshape(-1, 3).mean(axis=0)
    red, green, blue = (float(c) for c in rgb)
    return contract.Material(name or "unnamed", kind, (red, green, blue), roughness, 0.0 if paint else metallic, coat)


def _principled(material: bpy.types.Material | None) -> bpy.types.Node | None:
    tree = material.node_tree if material is not None else None
    return next((n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"), None) if tree else None


def linked_image(material: bpy.types.Material | None) -> bpy.types.Image | None:
    """The first image met upstream of the base color."""
    shader = _principled(material)
    sockets = [shader.inputs["Base Color"]] if shader is not None else []
    for _ in range(64):  # a tree deeper than this is no texture of a car
        if not sockets:
            break
        links = sockets.pop(0).links
        if not links:
            continue
        node = links[0].from_node
        if node.type == "TEX_IMAGE" and node.image is not None:
            return node.image
        sockets += list(node.inputs)
    return None
