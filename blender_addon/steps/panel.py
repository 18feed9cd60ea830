"""Where a step of the work stands, in words."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, TypeVar, cast

import bpy

from .. import compat
from ..translations import OWN_SENSE

T = TypeVar("T")
Kind = Literal["missing", "ready", "running", "done"]


@dataclass(frozen=True)
class State:
    """What a step's panel shows first.

    Panels ask for it at every redraw, so whoever makes one reads no meshes, and of files only what `on_disk` keeps.
    It is derived from what is there: no tick stands for something that was done once and may be gone.

    Attributes:
        kind: ``missing`` something, ``ready`` to go on, ``running``, or ``done``.
        words: one short sentence in plain words: what is missing, or what is there. Already in the user's language
            (``bpy.app.translations.pgettext_iface`` on the literal, then ``format``).
    """

    kind: Kind
    words: str


ICONS = {"missing": "RADIOBUT_OFF", "ready": "RADIOBUT_ON", "running": "TIME", "done": "CHECKMARK"}
LETTER_PX = 6.4  # mean width of a letter of the interface's font, at scale 1
FEWEST_LINES = 2  # that a state's sentence has room for
UNIT = re.compile(r"(?<=\d) (?=(?:s|min|h|kB|MB|GB|px)\b)")
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

    A subclass gives ``number``, ``bl_label`` and ``step_state = staticmethod(state)``.
    """

    number: int
    # Lines that the state's sentence has taken so far: a longer one moves what is below once, a shorter one nothing.
    reserved: ClassVar[dict[tuple[int, int], int]] = {}  # by step and letters in a line

    @staticmethod
    def step_state(context: bpy.types.Context) -> State:
        """Where the step stands; asked for at every redraw, so it must be quick."""
        raise NotImplementedError

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.label(text=str(self.number), icon=ICONS[self.step_state(context).kind], translate=False)

    def draw_inside(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        # Last: a sentence of one to four lines before the buttons would move them under the mouse.
        self.draw_step(context, layout)
        words, key = self.step_state(context).words, (self.number, letters(context))
        lines = len(wrapped(context, words))
        self.reserved[key] = max(FEWEST_LINES, lines, self.reserved.get(key, 0))
        paragraph(context, layout, words, empty=self.reserved[key] - lines)

    def draw_step(self, context: bpy.types.Context, layout: bpy.types.UILayout) -> None:
        """The step's settings and buttons."""
        raise NotImplementedError


def letters(context: bpy.types.Context) -> int:
    """How many letters a line of the sidebar has room for."""
    width = context.region.width if context.region else 0
    return max(24, int((width / context.preferences.system.ui_scale - MARGINS_PX) / LETTER_PX))


def wrapped(context: bpy.types.Context, text: str) -> list[str]:
    """Lines that fit the sidebar; a number stays with its unit."""
    return textwrap.wrap(UNIT.sub("\u00a0", text), letters(context))


def paragraph(
    context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str = "NONE", empty: int = 0
) -> None:
    """Text broken into as many lines as the sidebar's width asks for; Blender's labels would cut it off.

    Args:
        empty: lines that follow it.
    """
    column = layout.column(align=True)
    for number, line in enumerate([*wrapped(context, text), *[""] * empty]):
        column.label(text=line, icon=icon if number == 0 else ("BLANK1" if icon != "NONE" else "NONE"), translate=False)


def choice(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup, name: str) -> None:
    """Buttons side by side over the whole width; beside a label their words would be cut off."""
    row = layout.row()
    row.use_property_split = False
    row.prop(settings, name, expand=True)


def folder_setting(name: str, tip: str) -> bpy.props._PropertyDeferred:
    """A folder that the user chooses; ``//`` stands for the .blend's."""
    return bpy.props.StringProperty(name=name, description=tip, subtype="DIR_PATH", options=compat.path_options())


def angle(
    name: str, tip: str, default_deg: float, low_deg: float, high_deg: float, *, update: Callable[..., Any]
) -> bpy.props._PropertyDeferred:
    """An angle, given in degrees; Blender keeps it in radians."""
    low, high, default = (math.radians(x) for x in (low_deg, high_deg, default_deg))
    return bpy.props.FloatProperty(
        name=name, translation_context=OWN_SENSE, description=tip, subtype="ANGLE", step=100, update=update,
        default=default, min=low, max=high,
    )  # fmt: skip


class ViewportOverlay:
    """What is drawn over every 3D view that shows overlays: ``draw`` is called at each redraw, with its context.

    The handler belongs to the add-on, not to a file, and reads the open scene every time: loading and undo cannot lose
    it.
    """

    def __init__(self, draw: Callable[[bpy.types.Context], None], when: str) -> None:
        """``when``: POST_VIEW, in the scene's coordinates, or POST_PIXEL, in the region's pixels."""
        self._draw, self._when = draw, when
        self._handler: Any = None
        self._kept: tuple[object, Any] | None = None

    def register(self) -> None:
        if not bpy.app.background:  # without a window there is nothing to draw on
            self._handler = bpy.types.SpaceView3D.draw_handler_add(self._draw_over, (), "WINDOW", self._when)

    def _draw_over(self) -> None:
        if bpy.context.space_data.overlay.show_overlays:
            self._draw(bpy.context)

    def unregister(self) -> None:
        if self._handler is not None:
            bpy.types.SpaceView3D.draw_handler_remove(self._handler, "WINDOW")
        self._handler = self._kept = None

    def kept(self, key: object, make: Callable[[], T]) -> T:
        """What lies on the graphics card; made anew only when ``key``, all that it depends on, has changed."""
        if self._kept is None or self._kept[0] != key:
            self._kept = key, make()
        return cast(T, self._kept[1])
