"""Every difference between the Blender versions this add-on runs on (4.2 to 5.x), in one place."""

from __future__ import annotations

import importlib

import bpy


def sky_texture_kind() -> str:
    """The physical sky with one scattering event: `NISHITA` until 4.x, `SINGLE_SCATTERING` from 5.0."""
    return "SINGLE_SCATTERING" if bpy.app.version >= (5, 0, 0) else "NISHITA"


def has_denoiser() -> bool:
    """True when this build carries Open Image Denoise (Debian's does not)."""
    try:
        cycles = importlib.import_module("_cycles")
    except ImportError:
        return False
    return bool(getattr(cycles, "with_openimagedenoise", False))


def path_options() -> set[str]:
    """Options of a property that keeps a path: ``//`` stands for the .blend's folder; from 4.5 that must be said."""
    return {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5, 0) else set()


def shader_tree(material: bpy.types.Material) -> bpy.types.NodeTree | None:
    """The tree that gives a material its look; None where one of before 5.0 goes without."""
    return material.node_tree if bpy.app.version >= (5, 0, 0) or material.use_nodes else None


def march_volumes(scene: bpy.types.Scene, march: bool) -> None:
    """March through volumes in steps, or track collisions in them; before 5.0 Blender always marches."""
    if hasattr(scene.cycles, "volume_biased"):
        scene.cycles.volume_biased = march


def use_single_layer_exr(settings: bpy.types.ImageFormatSettings) -> None:
    """Ask for one uncompressed 32-bit RGBA layer; 5.0 wants the media type chosen first."""
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format = "OPEN_EXR"
    settings.color_mode = "RGBA"
    settings.color_depth = "32"
    settings.exr_codec = "NONE"
