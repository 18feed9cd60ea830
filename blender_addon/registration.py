"""What Blender is told about, in order; unregistered in reverse."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

import bpy

from .steps.bake import RaucaBake
from .steps.cameras.clip import RaucaClip
from .steps.cameras.properties import RaucaCameras
from .steps.camouflage.panel import RaucaCamouflage
from .steps.dataset import RaucaDataset
from .steps.evaluate import RaucaEvaluate
from .steps.optimize import RaucaOptimize
from .steps.photograph.properties import RaucaPhotograph
from .steps.vehicle.properties import RaucaVehicle
from .steps.weather.properties import RaucaWeather

# The panels appear in this order. A module's classes need no list; it may have ``register`` and ``unregister`` for
# handlers, timers, previews. Jobs come last: they are stopped before anything is taken away from them.
NAMES = """
    translations preferences steps.operator steps.on_disk steps.job_panel
    steps.vehicle.properties steps.vehicle.operators steps.vehicle.unwrap steps.vehicle.panel steps.vehicle.add_menu
    steps.vehicle.paint_overlay
    steps.weather.gallery steps.weather.properties steps.weather.panel steps.weather.rain_overlay
    steps.cameras.properties steps.cameras.presets steps.cameras.panel steps.cameras.clip steps.cameras.overlay
    steps.python_setup steps.dataset steps.frames_panel steps.optimize steps.demo
    steps.camouflage.panel steps.camouflage.operators steps.camouflage.detection_overlay steps.camouflage.drop
    steps.camouflage.assets
    steps.evaluate steps.camouflage.views_panel
    steps.photograph.properties steps.photograph.operators steps.photograph.marking steps.photograph.overlay
    steps.photograph.panel
    steps.bake steps.cost jobs.watch
"""
MODULES = [import_module(f".{name}", __package__) for name in NAMES.split()]
KINDS = (
    *(bpy.types.PropertyGroup, bpy.types.AddonPreferences, bpy.types.Operator, bpy.types.Panel),
    *(bpy.types.Menu, bpy.types.FileHandler),
)


class RaucaProperties(bpy.types.PropertyGroup):
    """``scene.rauca``: the add-on's settings, kept in the scene, one group a step."""

    vehicle: bpy.props.PointerProperty(type=RaucaVehicle)
    weather: bpy.props.PointerProperty(type=RaucaWeather)
    cameras: bpy.props.PointerProperty(type=RaucaCameras)
    clip: bpy.props.PointerProperty(type=RaucaClip)
    dataset: bpy.props.PointerProperty(type=RaucaDataset)
    optimize: bpy.props.PointerProperty(type=RaucaOptimize)
    camouflage: bpy.props.PointerProperty(type=RaucaCamouflage)
    evaluate: bpy.props.PointerProperty(type=RaucaEvaluate)
    photograph: bpy.props.PointerProperty(type=RaucaPhotograph)
    bake: bpy.props.PointerProperty(type=RaucaBake)


def classes_of(module: ModuleType) -> list[type]:
    """The classes that Blender is told about, as they stand in a module."""
    found = [thing for thing in vars(module).values() if isinstance(thing, type) and issubclass(thing, KINDS)]
    return [cls for cls in found if cls.__module__ == module.__name__]


def register() -> None:
    for module in MODULES:
        for cls in classes_of(module):
            bpy.utils.register_class(cls)
        getattr(module, "register", _nothing)()
    bpy.utils.register_class(RaucaProperties)
    bpy.types.Scene.rauca = bpy.props.PointerProperty(type=RaucaProperties)


def unregister() -> None:
    del bpy.types.Scene.rauca
    bpy.utils.unregister_class(RaucaProperties)
    for module in reversed(MODULES):
        getattr(module, "unregister", _nothing)()
        for cls in reversed(classes_of(module)):
            bpy.utils.unregister_class(cls)


def _nothing() -> None:
    pass
