"""What the cameras of the open scene stand around."""

from __future__ import annotations

import bpy

from ...scene.rendered import rendered
from ...scene.vehicle_reading import NOWHERE, Anchor, find_anchor

_known: dict[str, tuple[tuple[object, ...], Anchor]] = {}


def anchor(context: bpy.types.Context) -> Anchor:
    """The chosen vehicle's anchor; the world's origin when it is not in this scene. Quick enough for every redraw."""
    vehicle = context.scene.rauca.vehicle
    objects = rendered(vehicle.objects(context))
    if not objects:
        return NOWHERE
    request = vehicle.request()
    key = (request, *(_looks(thing) for thing in objects))
    scene = context.scene.name_full
    if scene not in _known or _known[scene][0] != key:
        _known[scene] = key, find_anchor(objects, request)
    return _known[scene][1]


def _looks(thing: bpy.types.Object) -> tuple[object, ...]:
    """What tells that an object was moved or reshaped; its box stands for its vertices."""
    corners = tuple(value for corner in thing.bound_box for value in corner)
    matrix = tuple(value for row in thing.matrix_world for value in row)
    return thing.name_full, thing.mode, len(thing.modifiers), corners, matrix
