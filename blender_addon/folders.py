"""The folders that the add-on writes to: its own, scratch folders, and those that the user chooses."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import bpy

from .core import contract, system

PREFIX = "rauca-scratch-"
MEMORY = Path("/dev/shm")
HELD = ".held"  # in a scratch folder: locked while somebody needs it
NEWBORN_S = 60.0  # a folder this young may not have been locked yet


def own_folder() -> Path:
    """A folder that belongs to the add-on and outlives updates; Blender's temporary one for a checkout."""
    try:
        return Path(bpy.utils.extension_path_user(__package__, create=True))
    except ValueError:  # not installed as an extension
        return Path(bpy.app.tempdir) / "rauca"


def scratch_base(in_memory: bool) -> Path:
    """Where temporary folders go: to memory where the system offers it, else to its temporary folder."""
    return MEMORY if in_memory and MEMORY.is_dir() else Path(tempfile.gettempdir())


@contextlib.contextmanager
def scratch_folder(in_memory: bool = False) -> Iterator[Path]:
    """Yield an empty folder; it is removed afterwards."""
    with tempfile.TemporaryDirectory(prefix=PREFIX, dir=scratch_base(in_memory)) as temporary:
        handle = system.hold(Path(temporary) / HELD)
        try:
            yield Path(temporary)
        finally:
            if handle is not None:
                system.let_go(handle)


def job_folder() -> Path:
    """A new folder for what only one job needs, locked until this process ends; those of dead ones are swept away."""
    sweep_scratch()
    folder = Path(tempfile.mkdtemp(prefix=PREFIX))
    system.hold(folder / HELD)
    return folder


def sweep_scratch() -> int:
    """Remove the folders of processes that were killed; returns how many."""
    swept = 0
    for base in {scratch_base(False), scratch_base(True)}:
        for folder in base.glob(PREFIX + "*"):
            with contextlib.suppress(OSError):  # in use, another user's, or just gone
                if time.time() - folder.stat().st_mtime < NEWBORN_S:
                    continue
                if (handle := system.hold(folder / HELD)) is not None:
                    system.let_go(handle)
                    shutil.rmtree(folder)
                    swept += 1
    return swept


def size_words(size_bytes: float) -> str:
    """A size for people: ``3 MB``, ``1.4 GB``."""
    megabytes = max(size_bytes / 1e6, 1.0)
    return f"{megabytes / 1e3:.1f} GB" if megabytes >= 1e3 else f"{megabytes:.0f} MB"


def chosen_folder(setting: str, what: str) -> Path:
    """A folder that the user chose to write ``what`` to; it may not be there yet.

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
