"""The device that a caller names: it holds for everything below, and nothing falls back to the CPU in silence."""

from __future__ import annotations

import logging

import torch

from ..contract import RaucaError

LOG = logging.getLogger(__name__)


def find_device(name: torch.device | str | None) -> torch.device:
    """The device of that name, e.g. ``cpu``, ``cuda`` or ``cuda:1``; a GPU if there is one, said in the log, when None.

    Raises:
        RaucaError: it cannot be used here.
    """
    if name is None:
        name = "cuda" if torch.cuda.is_available() else "cpu"
        if name == "cuda":
            LOG.warning("no device named: working on a GPU; name cpu to do without")
    try:
        device = torch.device(name)
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:  # each device's backend has its own
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise RaucaError(
            f"device {name}: torch cannot use it here ({reason}); choose another, `rauca doctor` lists what there is"
        ) from error
    return device
