"""A camouflage's file dropped into the viewport is put on the vehicle; any other picture is left to Blender."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...core import contract
from ..operator import RaucaOperator
from .operators import wear


class RAUCA_OT_drop_camouflage(RaucaOperator, bpy.types.Operator):
    """Paint the vehicle with a camouflage's file; it is added to the scene if it is one of Rauca's own"""

    bl_label = "Apply Camouflage File"

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        path = Path(bpy.path.abspath(self.filepath))
        if path.suffix.lower() == ".png" and not path.with_suffix(".json").is_file():
            return set(bpy.ops.object.empty_image_add("INVOKE_DEFAULT", filepath=str(path)))
        return super().execute(context)

    def work(self, context: bpy.types.Context) -> str:
        path = Path(bpy.path.abspath(self.filepath))
        contract.load_camouflage(path.with_suffix(".json"))  # any other .json is refused before it is chosen
        context.scene.rauca.camouflage.file = str(path)
        return wear(context)


class RAUCA_FH_camouflage(bpy.types.FileHandler):
    """Files that the viewport takes for camouflages."""

    bl_idname = "RAUCA_FH_camouflage"
    bl_label = "Camouflage"
    bl_import_operator = "rauca.drop_camouflage"
    bl_file_extensions = ".json;.png"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D" and context.mode == "OBJECT"
