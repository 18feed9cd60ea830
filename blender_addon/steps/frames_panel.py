"""The panel inside step 4 that leafs through the frames that are there."""

from __future__ import annotations

import bpy
from bpy.app.translations import pgettext_iface as iface

from ..core import contract
from ..jobs import pictures
from .on_disk import chosen_path, finished_frames
from .panel import SidebarPanel

PICTURE = "browsed."  # what names of browsed pictures begin with


class RAUCA_PT_frames(SidebarPanel, bpy.types.Panel):
    """Look at the frames that are there"""

    bl_parent_id = "RAUCA_PT_dataset"
    bl_label = "Frames"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(finished_frames(context.scene.rauca.dataset.folder))

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        settings = context.scene.rauca.dataset
        frames = finished_frames(settings.folder)
        at = min(settings.shown, len(frames))
        shown = frames[at - 1]
        layout.template_icon(_picture(settings.folder, shown.id), scale=10)
        layout.prop(settings, "shown")
        words = iface("{at} of {count}: {weather}, view {view}")
        text = words.format(at=at, count=len(frames), weather=shown.weather.name, view=shown.view + 1)
        layout.label(text=text, translate=False)


def _picture(folder: str, frame: str) -> int:
    """The icon of a frame's picture; one is kept at a time."""
    path = contract.frame_folder(chosen_path(folder), frame) / "image.png"
    name = f"{PICTURE}{path}"
    if pictures.shown(name) is None:
        pictures.forget(PICTURE)
    return pictures.load(name, path)
