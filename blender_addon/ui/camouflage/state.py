"""Where the camouflage stands."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.translations import pgettext_iface as iface

from ...scene.coating import Coat
from ..state import State


def state(context: bpy.types.Context) -> State:
    """Quick: looks at the settings only."""
    settings = context.scene.rauca.camouflage
    if settings.coat is not None:
        name = settings.coat.get("rauca_camouflage", "")
        words = {
            "ORIGINAL": iface("The original paint shows; {name} is hidden"),
            "CAMOUFLAGE": iface("The vehicle wears {name}"),
            "BAKED": iface("The vehicle wears {name}, baked"),
        }
        return State("done", words[Coat(settings.coat).shown].format(name=name))
    if not settings.file:
        return State("missing", iface("Choose a camouflage: the .json file that step 5 wrote"))
    return State("ready", iface("Ready to apply {name}").format(name=Path(settings.file).name))
