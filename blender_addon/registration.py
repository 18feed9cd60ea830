"""What Blender is told about, in order; unregistered in reverse.

Every module lists its CLASSES, and may have ``register`` and ``unregister`` for handlers, timers, previews.
"""

from __future__ import annotations

from types import ModuleType

import bpy

from .operators import apply_camouflage, generate_dataset
from .ui import bake, cameras, camouflage, dataset, optimise, properties, vehicle, weather

MODULES: tuple[ModuleType, ...] = (
    generate_dataset,
    apply_camouflage,
    # The panels appear in this order.
    vehicle,
    weather,
    cameras,
    dataset,
    optimise,
    camouflage,
    bake,
    properties,  # after the groups it points to
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
