"""A street of the data set's town around a vehicle in the artist's scene, and its removal."""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..core import contract
from .blocks import Since, all_blocks
from .town import Town

MARK = "rauca_street"  # on every data block of a street


def build(
    scene: bpy.types.Scene, seed: int, location: int, vehicle_to_world: NDArray[np.float64]
) -> tuple[bpy.types.Collection, float]:
    """Build a location's street where it runs past the vehicle as in the data set; the vehicle stays where it is.

    Returns:
        The street's collection, and how far it is turned from its place in the data set, degrees.
    """
    new = Since()
    town = Town(scene, seed)
    town.enter(location)
    moved = vehicle_to_world @ np.linalg.inv(town.pose(location))
    fresh = new.blocks()
    for block in fresh:
        block[MARK] = True
    collection = next(block for block in fresh if isinstance(block, bpy.types.Collection))
    for thing in collection.objects:
        thing.matrix_world = Matrix(moved.tolist()) @ thing.matrix_world
        thing.hide_select = True
    return collection, math.degrees(math.atan2(moved[1, 0], moved[0, 0]))


def lamps(collection: bpy.types.Collection | None) -> list[bpy.types.Object]:
    """The street's lamps; none without a street."""
    return [thing for thing in collection.objects if thing.type == "LIGHT"] if collection is not None else []


def remove(scene: bpy.types.Scene, collection: bpy.types.Collection) -> None:
    """Remove a street and all that came with it, but for what something of the artist's uses by now."""
    if collection.library is not None:
        raise contract.RaucaError(f"collection {collection.name!r} is linked from a file; remove it there")
    for thing in [thing for thing in collection.objects if MARK not in thing]:
        scene.collection.objects.link(thing)  # the artist's own: he may have put it among the houses
    things = [thing for thing in collection.objects if MARK in thing]
    bpy.data.batch_remove([*things, collection])
    while unused := [block for block in all_blocks() if MARK in block and block.users == 0]:
        bpy.data.batch_remove(unused)
