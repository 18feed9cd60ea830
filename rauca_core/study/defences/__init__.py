"""Image pre-processing in front of a detector: what a defender might do to a camouflaged picture."""

from __future__ import annotations

from ...contract import RaucaError
from .interface import NO_DEFENCE, Defence
from .lgs import LocalGradientsSmoothing
from .nutnet import NutNet
from .pad import Pad
from .reference import BitDepth, Jpeg, Median, Nothing

__all__ = ["KINDS", "NO_DEFENCE", "Defence", "make_defence"]

KINDS: dict[str, type[Defence]] = {
    kind.kind: kind for kind in (Nothing, LocalGradientsSmoothing, Pad, Jpeg, BitDepth, Median, NutNet)
}


def make_defence(name: str) -> Defence:
    """A defence by name, such as ``lgs``, or with parameters, ``jpeg:quality=50`` or ``lgs:block=9,overlap=3``.

    Raises:
        RaucaError: unknown name or parameter, a value that is no number or out of range, one that has learnt nothing.
    """
    kind_name, _, settings = name.partition(":")
    if kind_name not in KINDS:
        raise RaucaError(f"defence {name!r}: unknown; there are {', '.join(KINDS)}")
    kind = KINDS[kind_name]
    given = [(key, value) for key, _, value in (part.partition("=") for part in settings.split(",") if part)]
    if len(dict(given)) < len(given):
        raise RaucaError(f"defence {name!r}: a parameter is given twice; give each once")
    try:
        made = kind.make(**dict(given))
    except RaucaError as error:
        have = ", ".join(f"{key}={value}" for key, value in kind.parameters().items()) or "no parameters"
        raise RaucaError(f"defence {name!r}: {error}; {kind_name} has {have}") from None
    _ = made.fingerprint  # one that must learn says here that it did not
    return made
