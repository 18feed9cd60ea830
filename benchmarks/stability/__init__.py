"""The hard cases: what one is, what must come of it, and a way to try it in each precision."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import torch

DTYPES = (torch.float32, torch.bfloat16, torch.float64)
Pointless = Mapping[torch.dtype, str]
NEVER: Pointless = {}
Body = TypeVar("Body", bound=Callable[..., str | None])


class UnexpectedError(AssertionError):
    """A case came out otherwise than it must."""


@dataclass(frozen=True)
class Check:
    """One hard case.

    Attributes:
        part: of the house: rasterizer, renderer, environment, losses or optimizer.
        name: for tables and tests.
        attempt: tries it in a precision; says what came of it if that is more than what was ``expected``.
        pointless: precisions in which the case has no meaning, and why.
    """

    part: str
    name: str
    expected: str
    attempt: Callable[[torch.dtype], str | None]
    pointless: Pointless = field(default_factory=dict)


class Checks(list[Check]):
    """The hard cases of one part, in the order in which they are written."""

    def __init__(
        self, part: str, given: Callable[[torch.dtype], Any] = lambda dtype: dtype, pointless: Pointless = NEVER
    ) -> None:
        """``given`` is what attempts of this part take for a precision; ``pointless`` is said of every case."""
        super().__init__()
        self._part, self._given, self._pointless = part, given, pointless

    def case(self, name: str, expected: str, pointless: Pointless = NEVER, **chosen: Any) -> Callable[[Body], Body]:
        """What is defined next tries this case, with keyword arguments ``chosen``."""
        never = {**self._pointless, **pointless}

        def add(body: Body) -> Body:
            self.append(Check(self._part, name, expected, lambda d: body(self._given(d), **chosen), never))
            return body

        return add


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
        return Outcome(True, check.attempt(dtype) or "as expected")
    except Exception as error:
        return Outcome(False, f"{type(error).__name__}: {error}".splitlines()[0])


def expect(holds: object, otherwise: str) -> None:
    """Raise :class:`UnexpectedError` with the words of ``otherwise`` unless ``holds``."""
    if not holds:
        raise UnexpectedError(otherwise)


def name_of(dtype: torch.dtype) -> str:
    return str(dtype).removeprefix("torch.")


def wide(dtype: torch.dtype) -> torch.dtype:
    """What is computed in: float64, or float32 for a network or an answer of bfloat16."""
    return torch.float64 if dtype == torch.float64 else torch.float32
