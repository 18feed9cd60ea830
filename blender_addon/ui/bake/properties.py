"""Settings of the bake, kept in the scene."""

from __future__ import annotations

import bpy

from ...translations import OWN_SENSE

SIZES = (512, 1024, 2048, 4096)


class RaucaBake(bpy.types.PropertyGroup):
    """Where the camouflage goes; ``baked_layer``, ``file`` and ``difference`` tell of the last bake."""

    layer: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="UV Layer",
        translation_context=OWN_SENSE,
        description="The UV layer to bake into; empty: the only one beside the camouflage's own",
    )
    size: bpy.props.EnumProperty(  # type: ignore[valid-type]
        name="Size",
        items=[(str(size), f"{size} px", f"{size} x {size} texels") for size in SIZES],
        default="2048",
        description="Width and height of the image",
    )
    folder: bpy.props.StringProperty(  # type: ignore[valid-type]
        name="Folder", subtype="DIR_PATH", description="The image is written here, and kept inside the .blend as well"
    )
    allow_overlaps: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Allow Overlaps",
        description="Bake although parts share texels, such as mirrored sides: they get a mixture of both",
    )
    baked_layer: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    file: bpy.props.StringProperty(options={"HIDDEN"})  # type: ignore[valid-type]
    difference: bpy.props.FloatProperty(options={"HIDDEN"})  # type: ignore[valid-type]
