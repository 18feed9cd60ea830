"""The look that the panels share: a step's has its number, name and state in the header, the state's words on top."""

from __future__ import annotations

import textwrap
from typing import ClassVar

import bpy

from .state import State

ICONS = {"missing": "RADIOBUT_OFF", "ready": "RADIOBUT_ON", "running": "TIME", "done": "CHECKMARK"}
LETTER_PX = 6.4  # mean width of a letter of the interface's font, at scale 1
MARGINS_PX = 64.0  # of the sidebar beside a line of text: borders, icon, tabs


class SidebarPanel:
    """Base of a panel in Rauca's tab of the sidebar; the subclass also derives from ``bpy.types.Panel``."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Rauca"
    # The whole order of work shows at a glance: only the first step is open to begin with.
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}
    layout: bpy.types.UILayout

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        self.draw_inside(context, self.layout)

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        """The settings and buttons; names stand beside their settings."""
        raise NotImplementedError


class StepPanel(SidebarPanel):
    """Base of a step's panel.

    A subclass gives ``number``, ``bl_label``, ``bl_idname`` and ``step_state = staticmethod(state)``.
    """

    number: int

    @staticmethod
    def step_state(context: bpy.types.Context) -> State:
        """Where the step stands; asked for at every redraw, so it must be quick."""
        raise NotImplementedError

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.label(text=str(self.number), icon=ICONS[self.step_state(context).kind], translate=False)

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        paragraph(context, layout, self.step_state(context).words)
        self.draw_step(context, layout)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        """The step's settings and buttons."""
        raise NotImplementedError


def paragraph(context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str = "NONE") -> None:
    """Text broken into as many lines as the sidebar's width asks for; Blender's labels would cut it off."""
    scale = context.preferences.system.ui_scale
    width = context.region.width if context.region else 0
    letters = max(24, int((width / scale - MARGINS_PX) / LETTER_PX))
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, letters)):
        column.label(text=line, icon=icon if number == 0 else ("BLANK1" if icon != "NONE" else "NONE"), translate=False)
