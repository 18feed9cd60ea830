"""torch's Adam and AdamW, bit for bit, without torch's compiler.

The first step of torch's own imports ``torch._dynamo`` to keep the compiler out of it: 1.9 CPU seconds in every process
that optimizes, and nothing here is compiled. Underneath its decorators each method is as it is written in torch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import torch

Optimizer = TypeVar("Optimizer", bound=type[torch.optim.Optimizer])
DECORATED = ("add_param_group", "state_dict", "load_state_dict", "zero_grad")


def _uncompiled(optimizer: Optimizer) -> Optimizer:
    for name in DECORATED:
        setattr(optimizer, name, _undecorated(optimizer, name))
    optimizer.step = torch.no_grad()(_undecorated(optimizer, "step"))  # type: ignore[method-assign]
    return optimizer


def _undecorated(optimizer: type, name: str) -> Callable[..., Any]:
    method = getattr(optimizer, name)
    return getattr(method, "__wrapped__", method)


@_uncompiled
class Adam(torch.optim.Adam):
    """``torch.optim.Adam``."""


@_uncompiled
class AdamW(torch.optim.AdamW):
    """``torch.optim.AdamW``."""
