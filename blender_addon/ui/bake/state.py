"""Where the bake stands."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.app.translations import pgettext_iface as iface

from ...operators import bake_camouflage
from ...scene.coating import Coat
from ..state import State


def state(context: bpy.types.Context) -> State:
    """Quick: looks at the settings only."""
    settings, coat = context.scene.rauca.bake, context.scene.rauca.camouflage.coat
    if bake_camouflage.running is not None:
        return State("running", iface("Baking; Esc stops it"))
    if coat is None:
        return State("missing", iface("Apply a camouflage first"))
    if not settings.folder:
        return State("missing", iface("Choose a folder for the image"))
    if Coat(coat).image("baked") is not None and settings.file:
        text = iface("Baked to {file}: colors differ by {share:.1%} on average")
        return State("done", text.format(file=Path(settings.file).name, share=settings.difference))
    return State("ready", iface("Ready to bake"))
