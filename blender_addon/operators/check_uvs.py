"""Check the UVs of the vehicle's paint, and show the faulty faces."""

from __future__ import annotations

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt

from ..scene.mesh_edits import select_faces
from ..scene.paint_layer import check_paint, polygons_of
from .operator import RaucaOperator, tooltip

KINDS = [
    ("ALL", "All", "Check the UVs and select every faulty face"),
    ("MISSING", "Missing", "Select the faces without a place in the texture"),
    ("OUTSIDE", "Outside", "Select the faces that reach beyond the texture's border"),
    ("OVERLAPPING", "Overlapping", "Select the faces that share a place in the texture with others"),
    ("UNEVEN", "Uneven", "Select the faces whose pattern would be over twice as fine or as coarse as elsewhere"),
]


class RAUCA_OT_check_uvs(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Check the UVs of the paint and select the faulty faces"""

    bl_idname = "rauca.check_uvs"
    bl_label = "Check"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute
    kind: bpy.props.EnumProperty(name="Faults", items=KINDS)  # type: ignore[valid-type]

    @classmethod
    def description(cls, context: bpy.types.Context, properties: RAUCA_OT_check_uvs) -> str:
        return tooltip(KINDS, properties.kind)

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        if context.scene.rauca.vehicle.picked(context) is None:
            return rpt("Pick the vehicle's object or collection first")
        return ""

    def work(self, context: bpy.types.Context) -> str:
        settings = context.scene.rauca.vehicle
        active = context.view_layer.objects.active
        if active is not None and active.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        reading = settings.reading(context)
        faults = check_paint(reading)
        kinds = {name.lower(): getattr(faults, name.lower()) for name, *_ in KINDS[1:]}
        for name, faces in kinds.items():
            setattr(settings, name, int(faces.sum()))
        settings.checked = True
        every = np.logical_or.reduce(list(kinds.values()))
        shown = every if self.kind == "ALL" else kinds[self.kind.lower()]
        if not shown.any():
            return "No faults found"
        select_faces(context, polygons_of(reading, shown))
        return rpt("{count} faulty triangles, selected in the viewport").format(count=int(shown.sum()))


CLASSES = (RAUCA_OT_check_uvs,)
