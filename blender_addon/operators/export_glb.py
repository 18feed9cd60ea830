"""Save the vehicle with its baked camouflage as a GLB."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..core import contract
from ..scene.baked_export import export_glb
from ..scene.mesh_edits import object_mode
from .on_vehicle import coat_shown, painted_surface
from .operator import RaucaOperator


class RAUCA_OT_export_glb(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Save the vehicle with the baked camouflage as a GLB, for game engines, simulators and viewers"""

    bl_idname = "rauca.export_glb"
    bl_label = "Export GLB"
    bl_options = {"REGISTER"}  # noqa: RUF012 - Blender reads it as a class attribute
    filepath: bpy.props.StringProperty(name="File", subtype="FILE_PATH", options={"SKIP_SAVE"})  # type: ignore[valid-type]
    filter_glob: bpy.props.StringProperty(default="*.glb", options={"HIDDEN"})  # type: ignore[valid-type]

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        coat = coat_shown(context)
        return rpt("Bake the camouflage first") if coat is None or coat.image("baked") is None else ""

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.filepath:
            self.filepath = str(Path(context.scene.rauca.bake.file).with_suffix(".glb"))
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def work(self, context: bpy.types.Context) -> str:
        if not self.filepath:
            raise contract.RaucaError("No file: choose where to save the GLB")
        path = Path(bpy.path.abspath(self.filepath)).with_suffix(".glb")
        with object_mode(context):
            surface, coat = painted_surface(context)
            export_glb(context, surface, coat, context.scene.rauca.bake.baked_layer, path)
        return rpt("{file} saved").format(file=path.name)


CLASSES = (RAUCA_OT_export_glb,)
