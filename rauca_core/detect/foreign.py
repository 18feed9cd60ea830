"""Packages that are no requirement of rauca's core: imported when they are wanted, their errors told in one line."""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Iterator
from typing import Any

from ..contract import RaucaError


def extra(module: str) -> Any:
    """Import a package of the extra ``detectors``; raises :class:`RaucaError` that says how to get it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        missing = error.name or module
        raise RaucaError(f"{missing} is not installed; install it with `pip install 'rauca[detectors]'`") from error


def first_line(error: Exception) -> str:
    """What an error says, which may run over pages."""
    lines = str(error).strip().splitlines()
    return (lines[0].strip() if lines else type(error).__name__)[:200]


@contextlib.contextmanager
def changed(holder: Any, **values: Any) -> Iterator[None]:
    """Other attributes of a foreign object for a while."""
    before = {name: getattr(holder, name) for name in values}
    try:
        for name, value in values.items():
            setattr(holder, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(holder, name, value)
