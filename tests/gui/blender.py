"""A real Blender in its window, driven by the mouse."""

from __future__ import annotations

import json
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .screen import Screen

PROBE = Path(__file__).with_name("probe.py")
PATIENCE_S = 240.0


class Blender:
    """One Blender window; questions go through its probe, work through the mouse.

    Args:
        scratch: a folder of the test's own as Blender sees it; ``outside`` is the same seen from here.
    """

    def __init__(self, screen: Screen, program: str, scratch: Path, outside: Path) -> None:
        self.screen, self.scratch, self.outside = screen, scratch, outside
        (outside / "probe.py").write_text(PROBE.read_text(encoding="utf-8"), encoding="utf-8")
        door = outside / "door"
        door.unlink(missing_ok=True)
        width, height = screen.size
        arguments = ["--window-geometry", "0", "0", str(width), str(height), "--python-exit-code", "3"]
        arguments += ["-P", str(scratch / "probe.py"), "--", str(scratch / "door")]
        self.process = screen.start([program, *arguments], outside / "blender.log", **self.resources(scratch))
        self._line = socket.socket(socket.AF_UNIX)
        self._line.settimeout(PATIENCE_S)
        self.wait(door.exists, "Blender's window")
        self._line.connect(str(door))
        self.ask("value = True")

    @staticmethod
    def resources(scratch: Path) -> dict[str, str]:
        """Settings and extensions of the test's own, beside the user's."""
        return {"BLENDER_USER_RESOURCES": str(scratch / "user"), "HOME": str(scratch)}

    def close(self) -> None:
        self.process.terminate()
        try:
            self.process.wait(30)
        except subprocess.TimeoutExpired:
            self.process.kill()
        self._line.close()

    def ask(self, code: str) -> Any:
        """Run ``code`` in Blender's thread; returns what it leaves in ``value``."""
        self._line.sendall(json.dumps({"code": code}).encode() + b"\n")
        answer = b""
        while not answer.endswith(b"\n"):
            part = self._line.recv(1 << 20)
            if not part:
                raise RuntimeError(f"Blender has gone: {(self.outside / 'blender.log').read_text()[-2000:]}")
            answer += part
        reply = json.loads(answer)
        if "error" in reply:
            raise RuntimeError(reply["error"])
        return reply["value"]

    def settings(self, path: str) -> Any:
        """A setting of the add-on, such as ``vehicle.origin``."""
        return self.ask(f"value = bpy.context.scene.rauca.{path}")

    def wait(self, met: Callable[[], Any], what: str, patience: float = PATIENCE_S, pause: float = 0.2) -> Any:
        """Wait until ``met`` is true and return what it gives."""
        until = time.monotonic() + patience
        while time.monotonic() < until:
            if self.process.poll() is not None:
                raise RuntimeError(f"Blender has ended: {(self.outside / 'blender.log').read_text()[-2000:]}")
            if found := met():
                return found
            time.sleep(pause)
        raise TimeoutError(what)

    def shoot(self, name: str) -> Path:
        """A screenshot once drawing has come to rest."""
        self.screen.move(*self.away())
        before = b""
        for _ in range(40):
            time.sleep(0.5)
            self.screen.shoot(self.scratch / f"{name}.png")
            now = (self.outside / f"{name}.png").read_bytes()
            if now == before:
                break
            before = now
        return self.outside / f"{name}.png"

    def away(self) -> tuple[float, float]:
        """A place in the viewport where the mouse is over nothing."""
        left, top, width, height = self.region("WINDOW")
        return left + width * 0.3, top + height * 0.93

    def region(self, kind: str) -> tuple[int, int, int, int]:
        """Left, top, width and height of a region of the 3D view, pixels from the top left."""
        x, y, width, height = self.ask(
            "area = next(a for a in bpy.context.window_manager.windows[0].screen.areas if a.type == 'VIEW_3D')\n"
            f"r = next(r for r in area.regions if r.type == {kind!r})\n"
            "value = [r.x, r.y, r.width, r.height]"
        )
        return x, self.screen.size[1] - y - height, width, height
