"""Give the vehicle a second UV layer, for baking into."""

from __future__ import annotations

import bpy
import numpy as np

from ..core import contract
from ..scene.mesh_edits import object_mode, require_own_faces
from ..scene.smart_project import smart_project
from .on_vehicle import coat_shown, painted_surface
from .operator import RaucaOperator

LAYER = "baked"


class RAUCA_OT_new_uv_layer(RaucaOperator, bpy.types.Operator):  # noqa: N801 - Blender wants this form
    """Add a UV layer in which Blender's Smart UV Project lays out the vehicle's paint"""

    bl_idname = "rauca.new_uv_layer"
    bl_label = "New UV layer"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads it as a class attribute

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if coat_shown(context) is None:
            cls.poll_message_set("Apply a camouflage first")
            return False
        return True

    def work(self, context: bpy.types.Context) -> str:
        with object_mode(context):
            surface, _ = painted_surface(context)
            pieces = surface.painted_pieces()
            require_own_faces(piece for piece, _ in pieces)
            full = [piece.owner.name for piece, _ in pieces if len(piece.owner.data.uv_layers) >= 8]
            if full:
                raise contract.RaucaError(f"{full[0]}: has 8 UV layers, Blender's most; remove one")
            name = _free_name([piece.owner.data for piece, _ in pieces])
            uvs = np.zeros_like(surface.vehicle.uvs)
            uvs[surface.paint] = smart_project(surface.vehicle)
            for piece, span in pieces:
                _write(piece.owner.data, name, piece.loops[surface.paint[span]], uvs[span][surface.paint[span]])
        context.scene.rauca.bake.layer = name
        return f"UV layer {name} added"


def _write(mesh: bpy.types.Mesh, name: str, loops: np.ndarray, uvs: np.ndarray) -> None:
    active = mesh.uv_layers.active
    shown = active.name if active is not None else ""
    layer = mesh.uv_layers.new(name=name, do_init=False)
    values = np.zeros((len(mesh.loops), 2), np.float32)
    values[loops.ravel()] = uvs.reshape(-1, 2)
    layer.uv.foreach_set("vector", values.ravel())
    if shown:
        mesh.uv_layers.active = mesh.uv_layers[shown]
    mesh.update()


def _free_name(meshes: list[bpy.types.Mesh]) -> str:
    taken = {layer.name for mesh in meshes for layer in mesh.uv_layers}
    return next(n for n in (LAYER, *(f"{LAYER}.{i:03}" for i in range(1, 100))) if n not in taken)


CLASSES = (RAUCA_OT_new_uv_layer,)
