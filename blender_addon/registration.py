"""What Blender is told about, in order; unregistered in reverse.

Every module lists its CLASSES, and may have ``register`` and ``unregister`` for handlers, timers, previews.
"""

from __future__ import annotations

from types import ModuleType

import bpy

from . import preferences, translations
from .background import watch
from .operators import (
    add_vehicle,
    apply_camouflage,
    bake_camouflage,
    check_python,
    check_uvs,
    evaluated_view,
    export_glb,
    generate_dataset,
    leave_view,
    look_through,
    mark_paint,
    measure_pace,
    new_uv_layer,
    next_weather,
    optimize_camouflage,
    remove_camouflage,
    remove_street,
    remove_weather,
    set_up_street,
    show_paint,
    show_weather,
    steer_job,
    unwrap_paint,
    without_denoiser,
)
from .ui import bake, cameras, camouflage, dataset, optimize, properties, vehicle, weather

MODULES: tuple[ModuleType, ...] = (
    translations,
    preferences,
    add_vehicle,
    mark_paint,
    unwrap_paint,
    check_uvs,
    show_weather,
    remove_weather,
    next_weather,
    set_up_street,
    remove_street,
    look_through,
    leave_view,
    measure_pace,
    generate_dataset,
    without_denoiser,
    check_python,
    optimize_camouflage,
    steer_job,
    apply_camouflage,
    show_paint,
    remove_camouflage,
    evaluated_view,
    new_uv_layer,
    bake_camouflage,
    export_glb,
    # The panels appear in this order.
    vehicle,
    weather,
    cameras,
    dataset,
    optimize,
    camouflage,
    bake,
    properties,  # after the groups it points to
    watch,  # last, so that jobs are stopped first
)


def register() -> None:
    for module in MODULES:
        for cls in module.CLASSES:
            bpy.utils.register_class(cls)
        getattr(module, "register", _nothing)()


def unregister() -> None:
    for module in reversed(MODULES):
        getattr(module, "unregister", _nothing)()
        for cls in reversed(module.CLASSES):
            bpy.utils.unregister_class(cls)


def _nothing() -> None:
    pass
