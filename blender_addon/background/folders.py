"""The folders of a job: the user's, looked at before anything starts, and one that only the job needs."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

import bpy

from ..core import contract
from ..own_folder import own_folder


def chosen_folder(setting: str, what: str) -> Path:
    """A folder that the user chose to write to; it may not be there yet.

    Args:
        setting: as Blender keeps it; ``//`` stands for the .blend file's folder.
        what: it is for, in words.

    Raises:
        RaucaError: none is chosen, it hangs on a .blend that was never saved, or nothing can be written there.
    """
    if not setting.strip():
        raise contract.RaucaError(f"Choose a folder for {what}")
    if setting.startswith("//") and not bpy.data.filepath:
        raise contract.RaucaError(f"{setting}: lies beside the .blend file, which has no place yet; save it first")
    folder = Path(bpy.path.abspath(setting)).absolute()
    there = next(path for path in (folder, *folder.parents) if path.exists())
    if not there.is_dir():
        raise contract.RaucaError(f"{there}: is a file, not a folder; choose another folder for {what}")
    if not os.access(there, os.W_OK | os.X_OK):
        raise contract.RaucaError(f"{there}: not writable; choose another folder for {what}")
    return folder


def refuse_foreign(folder: Path, mark: str, what: str) -> None:
    """Raise :class:`RaucaError` if ``folder`` holds files but not the one that marks it as ``what``."""
    if not folder.is_dir() or (folder / mark).exists():
        return
    if any(not entry.name.startswith(".") for entry in folder.iterdir()):
        raise contract.RaucaError(f"{folder}: holds other files and no {what}; choose an empty or a new folder")


def job_folder() -> Path:
    """A new folder for what only one job needs, in the add-on's own; those of dead Blenders are swept away."""
    base = own_folder() / "jobs"
    base.mkdir(parents=True, exist_ok=True)
    for left in base.iterdir():
        owner = left.name.partition("-")[0]
        if owner.isdigit() and not _is_alive(int(owner)):
            shutil.rmtree(left, ignore_errors=True)
    return Path(tempfile.mkdtemp(prefix=f"{os.getpid()}-", dir=base))


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass  # another user's
    return True
