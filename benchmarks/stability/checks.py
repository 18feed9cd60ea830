"""What a hard case is: what must come of it, and a way to try it in each precision."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import torch

DTYPES = (torch.float32, torch.bfloat16, torch.float64)
Try = Callable[[torch.dtype], str]


class UnexpectedError(AssertionError):
    """A case came out otherwise than it must."""


@dataclass(frozen=True)
class Check:
    """One hard case.

    Attributes:
        part: of the house: rasterizer, renderer, environment, losses or optimizer.
        name: for tables and tests.
        expected: what must come of it, in a few words.
        attempt: tries it in a precision and says what came of it; raises :class:`UnexpectedError`.
        pointless: precisions in which the case has no meaning, and why.
    """

    part: str
    name: str
    expected: str
    attempt: Try
    pointless: Mapping[torch.dtype, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """What came of a case in one precision. ``holds`` is None where the case has no meaning in it."""

    holds: bool | None
    happened: str


def outcome(check: Check, dtype: torch.dtype) -> Outcome:
    """Try a case. Whatever it raises is an outcome too: one broken case must not hide the others."""
    if dtype in check.pointless:
        return Outcome(None, check.pointless[dtype])
    try:
        return Outcome(True, check.attempt(dtype))
    except Exception as error:
        return Outcome(False, f"{type(error).__name__}: {error}".splitlines()[0])


def expect(holds: object, otherwise: str) -> None:
    """Raise :class:`UnexpectedError` with the words of ``otherwise`` unless ``holds``."""
    if not holds:
        raise UnexpectedError(otherwise)


def name_of(dtype: torch.dtype) -> str:
    """As in tables: ``float32``."""
    return str(dtype).removeprefix("torch.")
