"""Settings from a command line, a file or a caller: checked by their model, a mistake told in one line."""

from __future__ import annotations

from typing import Any, Self

from pydantic import BaseModel, ConfigDict, ValidationError

from ..contract import RaucaError


class Settings(BaseModel):
    """What a user may choose about a job."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def make(cls, **chosen: Any) -> Self:
        """The settings of ``chosen``, None meaning the default; raises :class:`RaucaError` naming the first bad one."""
        try:
            return cls(**{name: value for name, value in chosen.items() if value is not None})
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            told = f"{where}: {first['msg'].lower()}, not {first.get('input')!r}; choose another value"
            raise RaucaError(told) from None
