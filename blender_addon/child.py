"""Starting a job of this add-on in a process of its own: in another of this Blender, or in the wheel's Python."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy


def child_command(job: Path) -> list[str]:
    """The command that runs ``headless.main`` on a job's file, under the name that Blender gave the add-on."""
    package, root = str(__package__), str(Path(__file__).resolve().parent.parent)
    # Blender finds extensions (bl_ext...) by itself; a checkout must come before an installed copy.
    where = "" if "." in package else f"sys.path.insert(0, {root!r}); "
    code = f"import sys, importlib; {where}sys.exit(importlib.import_module({package + '.headless'!r}).main())"
    if blender := bpy.app.binary_path:
        return [blender, "-b", "--python-exit-code", "3", "--python-expr", code, "--", str(job)]
    return [sys.executable, "-c", code, str(job)]
