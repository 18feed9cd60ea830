"""The methods that camouflages are compared by, each from its paper, as settings of one optimizer."""

from collections.abc import Mapping
from typing import Any

from ...contract import RaucaError
from .active import ACTIVE
from .das import DAS
from .dta import DTA
from .fca import FCA
from .method import Method
from .ours import OURS
from .rauca_base import RAUCA_BASE
from .rauca_final import RAUCA_FINAL

METHODS: Mapping[str, Method] = {m.name: m for m in (DAS, FCA, DTA, ACTIVE, RAUCA_BASE, RAUCA_FINAL, OURS)}


def method_named(name: str) -> Method:
    """The method of that name; raises :class:`RaucaError` listing all when there is none."""
    if name not in METHODS:
        raise RaucaError(f"method: no {name!r}; choose one of {', '.join(METHODS)}")
    return METHODS[name]


def settings_of(name: str, /, **explicit: Any) -> dict[str, Any]:
    """What `make_settings` takes for a method; what is given explicitly wins, the camouflage's name included."""
    method = method_named(name)
    return {"name": method.name, **method.settings, **explicit, "method": method.name}


__all__ = ["METHODS", "Method", "method_named", "settings_of"]
