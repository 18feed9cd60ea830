"""Drawing over the 3D views, for as long as the add-on is enabled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy


class DrawnOver:
    """What is drawn over every 3D view: ``draw`` is called at each redraw of one, with ``bpy.context`` set to it.

    The handler belongs to the add-on, not to a file, and reads the open scene every time: loading and undo cannot lose
    it.
    """

    def __init__(self, draw: Callable[[], None], when: str) -> None:
        """``when``: POST_VIEW, in the scene's coordinates, or POST_PIXEL, in the region's pixels."""
        self._draw, self._when = draw, when
        self._handler: Any = None

    def register(self) -> None:
        if not bpy.app.background:  # without a window there is nothing to draw on
            self._handler = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", self._when)

    def unregister(self) -> None:
        if self._handler is not None:
            bpy.types.SpaceView3D.draw_handler_remove(self._handler, "WINDOW")
        self._handler = None
