"""Settings of the process for long work on a CPU: threads and memory."""

from __future__ import annotations

import contextlib
import ctypes
import sys
from collections.abc import Iterator

import torch

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # of glibc's mallopt


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
