"""The chosen vehicle's objects, for the steps that paint them."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ...core import contract
from ...scene.coating import Coat
from ...scene.mesh_edits import Surface
from ...scene.vehicle import NAME_KEY, add_vehicle, load_shipped, shipped_names

ATLAS_KEY = "rauca_placed_atlas"  # custom property of an object placed for a vehicle that is a file


def vehicle_for(context: bpy.types.Context, camouflage: Path) -> contract.Vehicle:
    """The vehicle of step 1; where none is chosen, the one of Rauca's own that a camouflage (.json) was made for.

    Raises:
        RaucaError: none is chosen and it is not one of Rauca's own, or it cannot be used.
    """
    settings = context.scene.rauca.vehicle
    made_for = contract.load_camouflage(camouflage)[0].vehicle_name
    if settings.origin != "FILE" and not settings.objects(context) and made_for in shipped_names():
        return load_shipped(made_for)
    return settings.chosen(context)


def objects_of(context: bpy.types.Context, vehicle: contract.Vehicle) -> list[bpy.types.Object]:
    """The objects of the scene that are ``vehicle``; none if it was not placed yet."""
    settings = context.scene.rauca.vehicle
    if settings.origin != "FILE":
        return list(settings.objects(context))
    return [thing for thing in context.scene.objects if thing.get(ATLAS_KEY) == vehicle.atlas_id][:1]


def place(context: bpy.types.Context, vehicle: contract.Vehicle) -> list[bpy.types.Object]:
    """Add ``vehicle`` to the scene at the 3D cursor; one of Rauca's own becomes the chosen one of step 1."""
    settings = context.scene.rauca.vehicle
    thing = add_vehicle(context.scene, vehicle, context.collection)
    thing[ATLAS_KEY] = vehicle.atlas_id
    if settings.origin != "FILE" and NAME_KEY in thing:
        settings.choose(thing)
    context.view_layer.update()
    return [thing]


def coat_shown(context: bpy.types.Context) -> Coat | None:
    """The camouflage that the scene's vehicle wears, or None."""
    tree = context.scene.rauca.camouflage.coat
    return Coat(tree) if tree is not None else None


def vehicle_gone(context: bpy.types.Context) -> bool:
    """Whether the vehicle that a camouflage was applied to is no longer in the scene."""
    settings = context.scene.rauca.camouflage
    if settings.coat is None:
        return False
    return settings.anchor is None or settings.anchor.name not in context.scene.objects


def require_coat(context: bpy.types.Context) -> Coat:
    """The camouflage that the scene's vehicle wears; raises :class:`RaucaError` if it wears none."""
    coat = coat_shown(context)
    if coat is None:
        raise contract.RaucaError("No camouflage on the vehicle; apply one first (step 6)")
    return coat


def painted_surface(context: bpy.types.Context) -> tuple[Surface, Coat]:
    """The chosen vehicle under its camouflage; raises as the two steps that this takes."""
    vehicle, coat = painted_vehicle(context)
    return surface_of(context, vehicle), coat


def painted_vehicle(context: bpy.types.Context) -> tuple[contract.Vehicle, Coat]:
    """The chosen vehicle, and the camouflage that it wears.

    Raises:
        RaucaError: it wears none, or was changed since.
    """
    coat = require_coat(context)
    vehicle = context.scene.rauca.vehicle.chosen(context)
    if coat.tree.get("rauca_atlas") != vehicle.atlas_id:
        text = rpt("{name}: its paint or UVs changed since the camouflage was applied; apply it again (step 6)")
        raise contract.RaucaError(text.format(name=vehicle.name))
    return vehicle, coat


def surface_of(context: bpy.types.Context, vehicle: contract.Vehicle) -> Surface:
    """The objects of the scene that are ``vehicle``, beside it.

    Raises:
        RaucaError: they are gone, or no longer the vehicle.
    """
    objects = objects_of(context, vehicle)
    if not objects:
        text = rpt("{name}: is no longer in this scene; apply the camouflage again (step 6)")
        raise contract.RaucaError(text.format(name=vehicle.name))
    return Surface.of(vehicle, objects)
