"""The add-on's settings, kept in the scene."""

from __future__ import annotations

import bpy

from ..core import assets


def _presets(self: bpy.types.PropertyGroup, context: bpy.types.Context | None) -> list[tuple[str, str, str]]:
    names = sorted(p.stem for p in (assets.assets_folder() / "weathers").glob("*.json"))
    return [(name, name.capitalize(), f"Weathers of the preset {name}") for name in names]


class RaucaProperties(bpy.types.PropertyGroup):
    """Settings of the data set; ``job`` and ``done`` show the work in progress."""

    vehicle: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Vehicle", default="sedan", description="A shipped vehicle's name, or an .obj, .glb or .blend file"
    )
    weathers: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Weathers", items=_presets, description="Every view is rendered in each weather of this preset"
    )
    locations: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Locations", default=1, min=1, max=100, description="Places in the town, each in another district"
    )
    azimuths: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Azimuths", default=8, min=1, max=360, description="Cameras on each ring around the vehicle"
    )
    size: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Size", default=320, min=64, max=4096, description="Frames are square, this many pixels wide"
    )
    samples: bpy.props.IntProperty(  # type: ignore[valid-type]
        name="Samples", default=8, min=1, max=4096, description="Cycles samples per pixel, before denoising"
    )
    denoise: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Denoise", default=True, description="Use Open Image Denoise; without it take 64 samples or more"
    )
    folder: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Folder", subtype="DIR_PATH", description="The data set is written here and nowhere else"
    )
    camouflage: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Camouflage", subtype="FILE_PATH", description="A camouflage's .json file"
    )
    job: bpy.props.StringProperty(options={"SKIP_SAVE"})  # type: ignore[valid-type]
    done: bpy.props.FloatProperty(options={"SKIP_SAVE"}, min=0.0, max=1.0)  # type: ignore[valid-type]
