"""How many CPU threads torch uses, and where."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import torch


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
