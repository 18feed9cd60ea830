"""What Blender is told about: properties, operators, panels. In that order; unregistered in reverse."""

from __future__ import annotations

import bpy

from .operators.apply_camouflage import RAUCA_OT_apply_camouflage
from .operators.generate_dataset import RAUCA_OT_generate_dataset
from .ui.panels import RAUCA_PT_camouflage, RAUCA_PT_dataset
from .ui.properties import RaucaProperties

CLASSES = (
    RaucaProperties,
    RAUCA_OT_apply_camouflage,
    RAUCA_OT_generate_dataset,
    RAUCA_PT_dataset,
    RAUCA_PT_camouflage,
)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.rauca = bpy.props.PointerProperty(type=RaucaProperties)


def unregister() -> None:
    del bpy.types.Scene.rauca
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
