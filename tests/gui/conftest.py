"""These tests need a real Blender with a window: ``make test-gui`` runs them, ``make test`` leaves them out.

``RAUCA_BLENDER`` is its program, ``RAUCA_BLENDER_ROOT`` the folder of the system it lives in if that is not this one
(a chroot), ``RAUCA_PYTHON`` the Python with rauca and torch as that system sees it; without one step 5 is left out.
Into a chroot, bind-mount the repository and its Python read-only at the places they have here; unmount them afterwards.
``RAUCA_PICTURES`` is where the screenshots go.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from .blender import Blender
from .screen import NEEDED, Screen, lacking
from .sidebar import Sidebar

collect_ignore_glob = [] if os.environ.get("RAUCA_BLENDER") else ["*"]

REPOSITORY = Path(__file__).resolve().parents[2]
SIZE = (1440, 1000)


@pytest.fixture(scope="session")
def desk() -> Iterator[Sidebar]:
    """A fresh Blender with the add-on installed from its zip, and the sidebar open at its tab."""
    program, root = os.environ["RAUCA_BLENDER"], Path(os.environ.get("RAUCA_BLENDER_ROOT", "/"))
    if missing := lacking(root, [*NEEDED, program]):
        pytest.fail(f"{root}: has no {', '.join(missing)}; install them there")
    outside = artists_folder(root / ("tmp" if root == Path("/") else "home"))
    scratch = Path("/") / outside.relative_to(root)
    screen = Screen(root, SIZE, outside / "screen.log")
    try:
        install(screen, program, scratch, outside)
        blender = Blender(screen, program, scratch, outside)
        try:
            yield Sidebar(blender)
        finally:
            blender.close()
    finally:
        screen.close()
        keep(outside)
        shutil.rmtree(outside, ignore_errors=True)


def artists_folder(parent: Path) -> Path:
    """A new folder, ``artist`` where that is free: screenshots show the beginning of paths."""
    try:
        (parent / "artist").mkdir()
    except FileExistsError:
        return Path(tempfile.mkdtemp(prefix="artist-", dir=parent))
    return parent / "artist"


def install(screen: Screen, program: str, scratch: Path, outside: Path) -> None:
    """Build the extension, and install and enable it as a user does from disk."""
    builder = [sys.executable, str(REPOSITORY / "tools" / "build_extension.py"), str(outside / "zip")]
    subprocess.run(builder, check=True)
    built = next((outside / "zip").glob("*.zip"))
    command = [program, "--command", "extension", "install-file", "-r", "user_default", "-e"]
    log = outside / "install.log"
    child = screen.start([*command, str(scratch / "zip" / built.name)], log, **Blender.resources(scratch))
    assert child.wait(300) == 0, log.read_text()


def keep(outside: Path) -> None:
    """Put screenshots and figures where they can be looked at."""
    target = Path(os.environ.get("RAUCA_PICTURES", REPOSITORY / "build" / "gui"))
    target.mkdir(parents=True, exist_ok=True)
    for file in (*outside.glob("*.png"), *outside.glob("*.json"), *outside.glob("*.log")):
        shutil.copy(file, target)
