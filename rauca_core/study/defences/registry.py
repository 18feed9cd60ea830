"""Defences by name."""

from __future__ import annotations

from dataclasses import Field
from typing import Any

from ...contract import RaucaError
from .interface import Configured, Defence
from .lgs import LocalGradientsSmoothing
from .pad import Pad
from .reference import BitDepth, Jpeg, Median, Nothing

KINDS: dict[str, type[Configured]] = {
    kind.kind: kind for kind in (Nothing, LocalGradientsSmoothing, Pad, Jpeg, BitDepth, Median)
}


def defence_names() -> tuple[str, ...]:
    """The names that :func:`make_defence` knows, ``none`` first."""
    return tuple(KINDS)


def make_defence(name: str) -> Defence:
    """A defence by name, such as ``lgs``, or with parameters, ``jpeg:quality=50`` or ``lgs:block=9,overlap=3``.

    Raises:
        RaucaError: unknown name or parameter, a value that is no number or out of range.
    """
    kind_name, _, settings = name.partition(":")
    if kind_name not in KINDS:
        raise RaucaError(f"defence {name!r}: unknown; there are {', '.join(KINDS)}")
    kind = KINDS[kind_name]
    given = [_parameter(name, kind, setting) for setting in settings.split(",")] if settings else []
    values = dict(given)
    if len(values) < len(given):
        raise RaucaError(f"defence {name!r}: a parameter is given twice; give each once")
    made: Any = kind(**values)
    defence: Defence = made
    return defence


def _parameter(name: str, kind: type[Configured], setting: str) -> tuple[str, int | float]:
    key, _, text = setting.partition("=")
    known = {field.name: field for field in kind.parameters()}
    if key not in known:
        have = ", ".join(f"{k}={field.default}" for k, field in known.items()) or "no parameters"
        raise RaucaError(f"defence {name!r}: unknown parameter {key!r}; {kind.kind} has {have}")
    return key, _number(name, known[key], text)


def _number(name: str, field: Field[Any], text: str) -> int | float:
    wanted: type[int] | type[float] = int if isinstance(field.default, int) else float
    try:
        value: int | float = wanted(text)
    except ValueError:
        sort = "a whole number" if wanted is int else "a number"
        raise RaucaError(
            f"defence {name!r}: {field.name}={text} is not {sort}; the default is {field.default}"
        ) from None
    return value
