"""The add-on's settings, kept in the scene: one group a step."""

from __future__ import annotations

import bpy

from .bake import RaucaBake
from .cameras import RaucaCameras
from .camouflage import RaucaCamouflage
from .dataset import RaucaDataset
from .optimize import RaucaOptimize
from .vehicle import RaucaVehicle
from .weather import RaucaWeather


class RaucaProperties(bpy.types.PropertyGroup):
    """``scene.rauca``."""

    vehicle: bpy.props.PointerProperty(type=RaucaVehicle)  # type: ignore[valid-type]
    weather: bpy.props.PointerProperty(type=RaucaWeather)  # type: ignore[valid-type]
    cameras: bpy.props.PointerProperty(type=RaucaCameras)  # type: ignore[valid-type]
    dataset: bpy.props.PointerProperty(type=RaucaDataset)  # type: ignore[valid-type]
    optimize: bpy.props.PointerProperty(type=RaucaOptimize)  # type: ignore[valid-type]
    camouflage: bpy.props.PointerProperty(type=RaucaCamouflage)  # type: ignore[valid-type]
    bake: bpy.props.PointerProperty(type=RaucaBake)  # type: ignore[valid-type]


CLASSES = (RaucaProperties,)


def register() -> None:
    bpy.types.Scene.rauca = bpy.props.PointerProperty(type=RaucaProperties)


def unregister() -> None:
    del bpy.types.Scene.rauca
