"""The add-on's tab, found and used as a hand does: steps by their headers, buttons by what they say when hovered."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any

from .blender import Blender

PANELS = ("vehicle", "weather", "cameras", "dataset", "optimize", "camouflage", "evaluate", "bake")
FIRST_HEADER, HEADER_PITCH = 16, 28  # pixels below the tab's top, and from one closed panel to the next
LOOK_EVERY = 8  # pixels: less than half a button's height
ANSWER_S = 40.0  # seconds after which a button is pressed again
TALLEST = 40  # pixels: of a button that is pressed in its middle
TABS = 25  # pixels at the right that the tabs take
COLUMNS = (0.62, 0.2, 0.875)  # of the width: where buttons and fields are


class Sidebar:
    """The tab "Rauca" of the 3D view's sidebar."""

    def __init__(self, blender: Blender) -> None:
        self.blender, self.screen = blender, blender.screen
        blender.ask("watch_add_on(heart)")

    def show(self) -> None:
        """Open the sidebar with N and click on its tabs until Rauca's comes."""
        self.screen.key("Escape")  # the splash
        self.screen.move(*self.blender.away())
        self.screen.key("n")
        self.blender.wait(lambda: self.blender.region("UI")[2] > 1, "the sidebar")
        left, top, width, height = self.blender.region("UI")
        for down in range(40, height, 25):
            self.screen.click(left + width - 10, top + down)
            time.sleep(0.3)
            if self.blender.ask(f"{UI}\nvalue = region.active_panel_category") == "Rauca":
                return
        raise LookupError("the sidebar has no tab Rauca")

    def open(self, number: int) -> None:
        """Open one step and close all others."""
        for _ in range(12):
            shown = self._shown()
            if shown == [number]:
                self._let_go(number)
                return
            # The first open panel's header lies where it would if all were closed.
            self.screen.click(*self._header(min(shown, default=number)))
            with contextlib.suppress(TimeoutError):  # a busy machine swallows a click, or hears it late
                self.blender.wait(lambda before=shown: self._shown() != before, "a panel to fold", patience=8)
            time.sleep(0.7)  # panels glide
        raise TimeoutError(f"step {number} does not open")

    def _let_go(self, number: int) -> None:
        """Click beside the panel's first setting, or on its first choice, which is made: that changes nothing.

        A header's quick click can pass for a drag over headers.
        """
        x, y = self._header(number)
        self.screen.click(x, y + HEADER_PITCH)
        time.sleep(0.5)

    def _shown(self) -> list[int]:
        """The steps whose panels are open."""
        self.blender.ask("heart.seen.clear()\nown('jobs.watch').redraw()")
        headers = "value = sum(name.endswith('.draw_header') for name in heart.seen)"
        self.blender.wait(lambda: self.blender.ask(headers) >= len(PANELS), "the sidebar to be drawn")
        seen = self.blender.ask("value = list(heart.seen)")
        return [i + 1 for i, name in enumerate(PANELS) if f"RAUCA_PT_{name}.draw" in seen]

    def find(self, wanted: str) -> tuple[float, float]:
        """The middle of a button or field.

        Args:
            wanted: a property's name, or an operator's call as far as it matters, such as ``rauca.bake(``.
        """
        left, top, width, height = self.blender.region("UI")
        below = FIRST_HEADER + HEADER_PITCH * min(self._shown(), default=0)  # off the headers of closed steps
        for start in (0.0, LOOK_EVERY / 2):
            for share in COLUMNS:
                across, down = left + (width - TABS) * share, top + below + start
                while down < top + height:
                    if self.says(wanted, across, down):
                        return across, self._middle(wanted, across, down)
                    down += LOOK_EVERY
        raise LookupError(f"no button for {wanted}")

    def says(self, wanted: str, x: float, y: float) -> bool:
        """Whether what lies at a place is the wanted property or operator."""
        self.screen.move(x, y)
        path, call = self.blender.ask("value = hovered()")
        # Blender 4 gives the property's name, 5 its whole path.
        return bool(path.rpartition(".")[2] == wanted or ("(" in wanted and wanted in call))

    def press(self, wanted: str, until: Callable[[], Any], patience: float = 240.0) -> Any:
        """Click a button until that has shown an effect: a busy machine may swallow a click."""
        tries = max(int(patience / ANSWER_S), 1)
        for i in range(tries):
            try:
                self.screen.click(*self.find(wanted))
            except LookupError:
                if i == 0:
                    raise
                # It was heard after all: the button has gone.
            with contextlib.suppress(TimeoutError):
                return self.blender.wait(until, f"the effect of {wanted}", patience=ANSWER_S)
        raise TimeoutError(f"{wanted} has no effect")

    def enter(self, wanted: str, text: str | int) -> None:
        """Double-click a field of the step and write into it."""
        self.screen.click(*self.find(wanted), times=2)
        time.sleep(0.5)
        self.screen.key("ctrl+a")
        self.screen.type(str(text))
        self.screen.key("Return")
        time.sleep(0.5)

    def unfold(self, below: str, wanted: str, skip: int = 0) -> None:
        """Open the panel "More" below the button or field ``below``, and ``skip`` pixels, until it shows ``wanted``.

        Every click that misses costs a look at the whole tab: ``skip`` what lies between.
        """
        _, y = self.find(below)
        left, _, width, _ = self.blender.region("UI")
        for down in range(TALLEST // 2 + skip, 3 * TALLEST + skip, LOOK_EVERY):
            self.screen.click(left + width * 0.2, y + down)
            time.sleep(1)  # panels glide
            with contextlib.suppress(LookupError):
                self.find(wanted)
                return
        raise LookupError(f"nothing below {below} opens and shows {wanted}")

    def turn(self, wanted: str, notches: int) -> None:
        """Turn the wheel over a menu with Ctrl held: goes on to the next entry, or back for fewer than 0."""
        self.screen.move(*self.find(wanted))
        time.sleep(0.3)
        self.screen.turn(notches, "ctrl")
        time.sleep(0.5)

    def _middle(self, wanted: str, x: float, y: float) -> float:
        below = y
        while below < y + TALLEST and self.says(wanted, x, below + 4):
            below += 4
        return (y + below) / 2

    def _header(self, number: int) -> tuple[float, float]:
        left, top, width, _ = self.blender.region("UI")
        return left + width * 0.2, top + FIRST_HEADER + HEADER_PITCH * (number - 1)


UI = """
area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == 'VIEW_3D')
region = next(r for r in area.regions if r.type == 'UI')
"""
