"""Temporary folders that a killed process does not leave behind for good: the next one sweeps them.

The kernel holds a lock on each folder in use and drops it with its owner; a folder without one is nobody's.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

PREFIX = "rauca-scratch-"
MEMORY = Path("/dev/shm")
NEWBORN_S = 60.0  # a folder this young may not have been locked yet


def scratch_base(in_memory: bool) -> Path:
    """Where temporary folders go: to memory where the system offers it, else to its temporary folder."""
    return MEMORY if in_memory and MEMORY.is_dir() else Path(tempfile.gettempdir())


@contextlib.contextmanager
def scratch_folder(in_memory: bool = False) -> Iterator[Path]:
    """Yield an empty folder; it is removed afterwards."""
    with tempfile.TemporaryDirectory(prefix=PREFIX, dir=scratch_base(in_memory)) as temporary:
        handle = os.open(temporary, os.O_RDONLY)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            yield Path(temporary)
        finally:
            os.close(handle)


def sweep_scratch() -> int:
    """Remove the folders of processes that were killed; returns how many."""
    swept = 0
    for base in {scratch_base(False), scratch_base(True)}:
        for folder in base.glob(PREFIX + "*"):
            with contextlib.suppress(OSError):  # in use, another user's, or just gone
                if time.time() - folder.stat().st_mtime < NEWBORN_S:
                    continue
                handle = os.open(folder, os.O_RDONLY)
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    shutil.rmtree(folder)
                    swept += 1
                finally:
                    os.close(handle)
    return swept
