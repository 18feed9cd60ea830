"""Settings from a command line, a file or a caller: checked by their model, a mistake told in one line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from ..contract import RaucaError

Settings = TypeVar("Settings", bound=BaseModel)


def checked(model: type[Settings], chosen: Mapping[str, Any]) -> Settings:
    """The settings of ``chosen``; raises :class:`RaucaError` naming the first bad one."""
    try:
        return model(**chosen)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise RaucaError(f"{where}: {first['msg'].lower()}, not {first.get('input')!r}; choose another value") from None
