"""What Blender is told about, in order; unregistered in reverse.

Every module lists its CLASSES, and may have ``register`` and ``unregister`` for handlers, timers, previews.
"""

from __future__ import annotations

from types import ModuleType

import bpy

from . import preferences, translations
from .jobs import watch
from .steps import bake, cameras, camouflage, dataset, job_panel, optimize, vehicle, weather


class RaucaProperties(bpy.types.PropertyGroup):
    """``scene.rauca``: the add-on's settings, kept in the scene, one group a step."""

    vehicle: bpy.props.PointerProperty(type=vehicle.RaucaVehicle)  # type: ignore[valid-type]
    weather: bpy.props.PointerProperty(type=weather.RaucaWeather)  # type: ignore[valid-type]
    cameras: bpy.props.PointerProperty(type=cameras.RaucaCameras)  # type: ignore[valid-type]
    dataset: bpy.props.PointerProperty(type=dataset.RaucaDataset)  # type: ignore[valid-type]
    optimize: bpy.props.PointerProperty(type=optimize.RaucaOptimize)  # type: ignore[valid-type]
    camouflage: bpy.props.PointerProperty(type=camouflage.RaucaCamouflage)  # type: ignore[valid-type]
    bake: bpy.props.PointerProperty(type=bake.RaucaBake)  # type: ignore[valid-type]


# The panels appear in this order; jobs are stopped before anything is taken away from them.
STEPS: tuple[ModuleType, ...] = (vehicle, weather, cameras, dataset, optimize, camouflage, bake)
MODULES: tuple[ModuleType, ...] = (translations, preferences, job_panel, *STEPS, watch)


def register() -> None:
    for module in MODULES:
        for cls in module.CLASSES:
            bpy.utils.register_class(cls)
        getattr(module, "register", _nothing)()
    bpy.utils.register_class(RaucaProperties)
    bpy.types.Scene.rauca = bpy.props.PointerProperty(type=RaucaProperties)


def unregister() -> None:
    watch.unregister()
    del bpy.types.Scene.rauca
    bpy.utils.unregister_class(RaucaProperties)
    for module in reversed(MODULES[:-1]):
        getattr(module, "unregister", _nothing)()
        for cls in reversed(module.CLASSES):
            bpy.utils.unregister_class(cls)


def _nothing() -> None:
    pass
