"""Where the choice of a vehicle stands."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.translations import pgettext_iface as iface

from ...operators.unwrap_paint import unwrapping
from ..state import State


def state(context: bpy.types.Context) -> State:
    """Quick: looks at the settings only."""
    settings = context.scene.rauca.vehicle
    if unwrapping():
        return State("running", iface("The paint is being unwrapped"))
    if settings.origin == "FILE":
        if not settings.file:
            return State("missing", iface("Choose a vehicle's file"))
        return State("done", iface("{name}, from its file").format(name=Path(settings.file).name))
    if settings.origin == "COLLECTION":
        picked, hint = settings.collection, iface("Choose the collection of the vehicle's parts")
    else:
        picked, hint = settings.object, iface("Pick an object, or add one of the vehicles below")
    if picked is None:
        return State("missing", hint)
    if settings.origin == "OBJECT" and picked.name not in context.scene.objects:
        return State("missing", iface("{name} is no longer in this scene; pick another").format(name=picked.name))
    if settings.paint == "FACES":
        if not settings.marked:
            return State("missing", iface("Select faces of {name} in edit mode and mark them").format(name=picked.name))
        return State("done", iface("{name}, {count} faces are paint").format(name=picked.name, count=settings.marked))
    return State("done", iface("{name} is the vehicle").format(name=picked.name))
