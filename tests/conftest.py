"""What several rooms' tests share: a tiny painted vehicle and where the real car lies."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
import torch
from hypothesis import settings

from benchmarks.stability.drawn import painted_box
from rauca_core.contract import Vehicle

REPOSITORY = Path(__file__).resolve().parent.parent
LONGEST_FIRST = ("pipelines", "faults", "blender", "attack")  # rooms that start processes, or optimize

settings.register_profile("rauca", deadline=None)  # a kernel's first call compiles it
settings.load_profile("rauca")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # What a shell starts in the background ignores Ctrl-C, and so would the commands that tests interrupt.
    signal.signal(signal.SIGINT, signal.default_int_handler)

if "PYTEST_XDIST_WORKER" in os.environ:  # one process a core: more threads would only get into each other's way
    torch.set_num_threads(1)
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # of the commands that tests start


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files begin first, so that no process is left alone with one at the end."""
    rooms = {room: place for place, room in enumerate(LONGEST_FIRST)}
    items.sort(key=lambda item: rooms.get(item.path.relative_to(REPOSITORY / "tests").parts[0], len(rooms)))


@pytest.fixture(scope="session")
def shared_folder() -> Path:
    """Inputs too large or not ours to keep in the repository; tests that need them are skipped without."""
    folder = Path(os.environ.get("RAUCA_SHARED", REPOSITORY.parent / "shared"))
    if not (folder / "vehicles").is_dir():
        pytest.skip("the shared inputs are not on this machine (set RAUCA_SHARED)")
    return folder


@pytest.fixture
def box_vehicle() -> Vehicle:
    """A 4 x 2 x 1.5 m box: its sides painted, each a chart of its own, its top of dark trim."""
    return painted_box()
