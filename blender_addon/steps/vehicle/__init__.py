"""Step 1: which vehicle, and what of it is paint."""

from __future__ import annotations

import bpy

from . import operators, unwrap
from .panel import RAUCA_PT_vehicle, RAUCA_PT_vehicle_paint, RAUCA_PT_vehicle_uvs, state
from .properties import RaucaVehicle

CLASSES = (
    RaucaVehicle,
    *operators.CLASSES,
    *unwrap.CLASSES,
    RAUCA_PT_vehicle,
    RAUCA_PT_vehicle_paint,
    RAUCA_PT_vehicle_uvs,
)

__all__ = ["CLASSES", "RaucaVehicle", "register", "state", "unregister"]


@bpy.app.handlers.persistent
def _recount(*given: object) -> None:
    """An undo in edit mode takes back the marks on the faces, but not their number in the settings."""
    bpy.context.scene.rauca.vehicle.count_marked(bpy.context)


def register() -> None:
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        handlers.append(_recount)


def unregister() -> None:
    unwrap.stop()
    for handlers in (bpy.app.handlers.undo_post, bpy.app.handlers.redo_post):
        if _recount in handlers:
            handlers.remove(_recount)
