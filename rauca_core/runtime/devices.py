"""The device that a caller names: it holds for everything below, and nothing falls back to the CPU in silence."""

from __future__ import annotations

import torch

from ..contract import RaucaError


def find_device(name: torch.device | str) -> torch.device:
    """The device of that name, e.g. ``cpu``, ``cuda`` or ``cuda:1``; raises RaucaError where it cannot be used."""
    try:
        device = torch.device(name)
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:  # each device's backend has its own
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise RaucaError(
            f"device {name}: torch cannot use it here ({reason}); choose another, `rauca doctor` lists what there is"
        ) from error
    return device
