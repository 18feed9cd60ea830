"""Commands that go on by themselves where an earlier run of theirs stopped."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from rauca_core.contract import RaucaError, StoppedError


@contextlib.contextmanager
def goes_on_by_itself() -> Iterator[None]:
    """Within, also as a decorator: a stop is told with what to do here, where there is no ``--resume``."""
    try:
        yield
    except StoppedError as stop:
        raise RaucaError(f"{stop.where}; run the same command again to go on") from None
