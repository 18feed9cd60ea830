"""The extension's own folder: the only place it writes to unasked."""

from __future__ import annotations

from pathlib import Path

import bpy


def own_folder() -> Path:
    """A folder that belongs to the add-on and outlives updates; Blender's temporary one for a checkout."""
    try:
        return Path(bpy.utils.extension_path_user(__package__, create=True))
    except ValueError:  # not installed as an extension
        return Path(bpy.app.tempdir) / "rauca"
