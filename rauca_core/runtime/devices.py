"""What work runs on: the device that a caller names, threads of the CPU, and its memory."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import sys
from collections.abc import Iterator

import torch

from ..contract import RaucaError

LOG = logging.getLogger(__name__)
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's mallopt


def find_device(name: torch.device | str | None) -> torch.device:
    """The device of that name, e.g. ``cpu``, ``cuda`` or ``cuda:1``; a GPU if there is one, said in the log, when None.

    Raises:
        RaucaError: it cannot be used here.
    """
    if name is None:
        name = "cuda" if torch.cuda.is_available() else "cpu"
        if name == "cuda":
            LOG.warning("no device named: working on a GPU; name cpu to do without")
    try:
        device = torch.device(name)
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:  # each device's backend has its own
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise RaucaError(
            f"device {name}: torch cannot use it here ({reason}); choose another, `rauca doctor` lists what there is"
        ) from error
    return device


@contextlib.contextmanager
def threads(number: int | None) -> Iterator[None]:
    """Run with ``number`` torch threads; None leaves the number alone.

    Elementwise work on texels and pixels takes well under a millisecond a pass. Split over threads, it waits for the
    last one at every pass: with another program on the machine that made some passes 15 times slower, so everything
    but the detector runs on one.
    """
    before = torch.get_num_threads()
    try:
        if number is not None:
            torch.set_num_threads(number)
        yield
    finally:
        torch.set_num_threads(before)


def keep_large_blocks() -> bool:
    """Let malloc keep freed blocks of any size; False where the C library is not glibc.

    By itself glibc returns blocks above 32 MiB to the system, and the next step pays for every page again: a step on
    the texels of a 2048 map took three times as long.
    """
    if not sys.platform.startswith("linux"):
        return False
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    return bool(mallopt(_M_MMAP_THRESHOLD, 1 << 30) and mallopt(_M_TRIM_THRESHOLD, 2**31 - 1))
