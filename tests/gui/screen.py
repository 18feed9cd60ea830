"""A virtual screen with a mouse, a keyboard and a camera, beside or inside the folder that holds Blender's system."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

NEEDED = ("Xvfb", "xdpyinfo", "xdotool", "import")


class Screen:
    """An X server without a screen.

    Args:
        root: folder of the system that Blender and these tools live in; ``/`` for this one.
        size: pixels, width and height.
        log: file for what the server says.
    """

    def __init__(self, root: Path, size: tuple[int, int], log: Path) -> None:
        self.root, self.size, self.clicks = root, size, 0
        self.number = next(n for n in range(90, 200) if not _taken(n))
        self._environment = {
            **os.environ,
            "DISPLAY": f":{self.number}",
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "GALLIUM_DRIVER": "llvmpipe",
            # The window's thread draws by itself, so that its time on a core tells of drawing too.
            "LP_NUM_THREADS": "0",
        }
        command = ["Xvfb", f":{self.number}", "-screen", "0", f"{size[0]}x{size[1]}x24", "+extension", "GLX"]
        self._server = self.start([*command, "-nolisten", "tcp"], log)
        for _ in range(600):
            if self.run(["xdpyinfo"], check=False).returncode == 0:
                return
            time.sleep(0.1)
        raise TimeoutError("the virtual screen did not start")

    def close(self) -> None:
        self._server.terminate()
        self._server.wait(30)

    def inside(self, command: Sequence[str]) -> list[str]:
        """A command as it is called from outside the root."""
        return list(command) if self.root == Path("/") else ["chroot", str(self.root), *command]

    def start(self, command: Sequence[str], log: Path, **more: str) -> subprocess.Popen[bytes]:
        """Start a program on this screen; what it says goes to ``log``."""
        with log.open("wb") as file:
            around = self._environment | more
            return subprocess.Popen(self.inside(command), env=around, stdout=file, stderr=subprocess.STDOUT)

    def run(self, command: Sequence[str], check: bool = True) -> subprocess.CompletedProcess[str]:
        command = self.inside(command)
        return subprocess.run(command, env=self._environment, capture_output=True, text=True, check=check)

    def move(self, x: float, y: float) -> None:
        """Move the mouse; pixels from the top left, as everywhere here."""
        self._do("mousemove", str(round(x)), str(round(y)))

    def click(self, x: float, y: float, times: int = 1) -> None:
        self.move(x, y)
        self.clicks += times
        time.sleep(0.4)  # the button under the mouse wakes up first
        self._do("click", "--repeat", str(times), "--delay", "60", "1")

    def turn(self, notches: int, held: str) -> None:
        """Turn the wheel where the mouse is, with a key held; fewer than 0 turns it up."""
        self._do("keydown", held)
        self._do("click", "--repeat", str(abs(notches)), "--delay", "150", "5" if notches > 0 else "4")
        self._do("keyup", held)

    def key(self, *names: str) -> None:
        self._do("key", "--delay", "60", *names)

    def type(self, text: str) -> None:
        self._do("type", "--delay", "25", text)

    def shoot(self, path: Path) -> None:
        """A picture of the whole screen; ``path`` is seen from inside the root."""
        self.run(["import", "-window", "root", str(path)])

    def _do(self, *action: str) -> None:
        self.run(["xdotool", *action])


def lacking(root: Path, programs: Sequence[str]) -> list[str]:
    """Which of the programs the root does not have."""
    if root == Path("/"):
        return [name for name in programs if shutil.which(name) is None]
    # A link inside the root may name its target by an absolute path, which leads nowhere from here.
    places = (root / "usr/bin", root / "bin")
    return [name for name in programs if not any(os.path.lexists(f"{place}/{Path(name).name}") for place in places)]


def _taken(number: int) -> bool:
    with open("/proc/net/unix", encoding="ascii") as file:
        return any(line.rstrip().endswith(f"/tmp/.X11-unix/X{number}") for line in file)
