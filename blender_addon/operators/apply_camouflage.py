"""Put a camouflage on its vehicle in the open scene."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from bpy.app.translations import pgettext_rpt as rpt
from mathutils import Matrix

from ..core import contract
from ..evaluation.found import find_evaluation
from ..scene.camouflages import read_paintwork
from ..scene.mesh_edits import Surface, object_mode
from ..scene.painting import paint_surface
from .on_vehicle import objects_of, place, vehicle_for
from .operator import RaucaOperator


class RAUCA_OT_apply_camouflage(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Paint the vehicle of step 1 with the chosen camouflage; it is added to the scene if it is not there"""

    bl_idname = "rauca.apply_camouflage"
    bl_label = "Apply Camouflage"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    def work(self, context: bpy.types.Context) -> str:
        settings = context.scene.rauca.camouflage
        if not settings.file:
            raise contract.RaucaError("No camouflage: choose its .json or .png file in step 6")
        path = Path(bpy.path.abspath(settings.file))
        with object_mode(context):
            vehicle = vehicle_for(context, path)
            paintwork = read_paintwork(path.with_suffix(".json"), vehicle.atlas_id)
            objects = objects_of(context, vehicle)
            surface = Surface.of(vehicle, objects or place(context, vehicle))
            coat = paint_surface(surface, paintwork)
        settings.coat = coat.tree
        anchor = surface.painted_pieces()[0][0].owner
        settings.anchor = anchor
        to_anchor = np.linalg.inv(np.array(anchor.matrix_world)) @ surface.vehicle_to_world()
        settings.vehicle_to_anchor = [x for row in Matrix(to_anchor.tolist()) for x in row]
        if not settings.study:
            found = find_evaluation(path)
            settings.study = str(found) if found is not None else ""
        return rpt("{name} is on {vehicle}").format(name=paintwork.name, vehicle=vehicle.name)


CLASSES = (RAUCA_OT_apply_camouflage,)
