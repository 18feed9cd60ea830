"""Runs inside the Blender under test: answers questions about it, and notes how long its window stays deaf.

``blender -P probe.py -- SOCKET``. A request is a line of JSON, {"code": ...}; the code sets ``value``. The test never
changes the scene through it: the mouse and the keyboard do.
"""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
import traceback
from pathlib import Path

import bpy

BEAT_S = 0.01
PANELS_AND_OPERATORS = (bpy.types.Panel, bpy.types.Operator)
OWN = ".rauca."  # part of the name of every module of the extension


class Heart:
    """Notes every gap between two turns of Blender's event loop, and the time the add-on itself takes of them."""

    def __init__(self) -> None:
        self._schedule = Path(f"/proc/self/task/{threading.get_native_id()}/schedstat")  # of the window's thread
        self.gaps: list[tuple[float, float, float]] = []
        self.own: list[tuple[str, float, float]] = []
        self.seen: dict[str, float] = {}  # when each watched function was last called
        self._last = self.now()

    def now(self) -> tuple[float, float, float]:
        """Seconds: wall, running on a core, ready to run without getting a core."""
        running, waiting, _ = self._schedule.read_text(encoding="ascii").split()
        return time.monotonic(), int(running) * 1e-9, int(waiting) * 1e-9

    def beat(self) -> None:
        now = self.now()
        self.gaps.append(tuple(round(b - a, 6) for a, b in zip(self._last, now, strict=True)))  # type: ignore[arg-type]
        self._last = now

    def take(self) -> dict[str, list[object]]:
        """What was noted since the last call."""
        taken: dict[str, list[object]] = {"gaps": [*self.gaps], "own": [*self.own]}
        self.gaps, self.own = [], []
        return taken

    def watch(self, owner: object, name: str) -> None:
        """Time a function of the add-on, in place."""
        plain = getattr(owner, name)
        called = f"{owner.__name__.rpartition('.')[2]}.{name}"  # type: ignore[attr-defined]

        def timed(*given: object) -> object:
            before = self.now()
            try:
                return plain(*given)
            finally:
                wall, _, waited = (b - a for a, b in zip(before, self.now(), strict=True))
                self.own.append((called, round(wall, 6), round(waited, 6)))
                self.seen[called] = time.monotonic()

        # Blender looks at the number of arguments before it calls.
        same_shape = {
            0: lambda: timed(),
            2: lambda self, context: timed(self, context),
            3: lambda self, context, event: timed(self, context, event),
        }
        setattr(owner, name, same_shape[plain.__code__.co_argcount])


class Probe:
    """The socket, looked at in Blender's own thread."""

    def __init__(self, path: str) -> None:
        self.heart = Heart()
        self._door = socket.socket(socket.AF_UNIX)
        self._door.bind(path)
        self._door.listen(1)
        self._door.setblocking(False)
        self._line: socket.socket | None = None
        self._heard = b""

    def beat(self) -> float:
        self.heart.beat()
        try:
            self._listen()
        except Exception:
            traceback.print_exc()
        return BEAT_S

    def _listen(self) -> None:
        if self._line is None:
            try:
                self._line, _ = self._door.accept()
            except BlockingIOError:
                return
            self._line.setblocking(False)
        try:
            heard = self._line.recv(1 << 16)
        except BlockingIOError:
            return
        if not heard:  # the test has gone; another may come
            self._line = None
            return
        self._heard += heard
        while b"\n" in self._heard:
            request, self._heard = self._heard.split(b"\n", 1)
            self._line.setblocking(True)
            self._line.sendall(self._answer(json.loads(request)["code"]).encode() + b"\n")
            self._line.setblocking(False)

    def _answer(self, code: str) -> str:
        names: dict[str, object] = {**globals(), "heart": self.heart}
        try:
            exec(code, names)
            return json.dumps({"value": names.get("value")})
        except Exception:
            return json.dumps({"error": traceback.format_exc()})


def watch_add_on(heart: Heart) -> None:
    """Time all that the add-on does in the window's thread by itself: its timer, its panels, its lines in the view."""
    registration = own("registration")
    for module in registration.MODULES:  # type: ignore[attr-defined]
        for cls in registration.classes_of(module):  # type: ignore[attr-defined]
            for name in ("draw", "draw_header", "modal") if issubclass(cls, PANELS_AND_OPERATORS) else ():
                if hasattr(cls, name):
                    heart.watch(cls, name)
    heart.watch(own("jobs.watch"), "tick")


def own(name: str) -> object:
    """A module of the installed extension, such as ``jobs.watch``."""
    found = [module for key, module in sys.modules.items() if key.endswith(f"{OWN}{name}")]
    if len(found) != 1:
        raise LookupError(f"{name}: {len(found)} modules")
    return found[0]


def view3d() -> tuple[bpy.types.Window, bpy.types.Area]:
    window = bpy.context.window_manager.windows[0]
    return window, next(area for area in window.screen.areas if area.type == "VIEW_3D")


def hovered() -> list[str]:
    """What the mouse is over in the sidebar: a property's path, and an operator's call with its settings."""
    window, area = view3d()
    sidebar = next(region for region in area.regions if region.type == "UI")
    with bpy.context.temp_override(window=window, area=area, region=sidebar):
        found = bpy.context.property
        path = found[1] if found else ""
        call = ""
        if bpy.ops.ui.copy_python_command_button.poll():
            bpy.ops.ui.copy_python_command_button()
            call = str(bpy.context.window_manager.clipboard)
    return [path, call]


def begin() -> Probe:
    probe = Probe(sys.argv[sys.argv.index("--") + 1])
    bpy.app.timers.register(probe.beat, persistent=True)
    return probe


if __name__ == "__main__":
    PROBE = begin()
