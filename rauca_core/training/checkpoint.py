"""Checkpoints of a training: network, moving average, optimizer; a killed run goes on to the same bits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.schema import read_json
from ..environment.training_state import restore, state_tensors
from ..runtime.checkpoint_files import POINTER, differences, read_tensors, write_checkpoint

FORMAT = ("rauca-detector-checkpoint", 2)
OTHER_RUN = "start the training in a new folder"
_MEAN = "average."


def save_run(
    folder: Path,
    identity: dict[str, Any],
    step: int,
    losses: list[float],
    network: nn.Module,
    average: nn.Module,
    optimizer: torch.optim.Optimizer,
) -> None:
    """Write everything that a step changes; the checkpoint before goes when this one is whole.

    Args:
        losses: of the steps whose round has not been reported.
    """
    tensors: dict[str, Tensor] = state_tensors(network, optimizer)
    tensors |= {_MEAN + name: value for name, value in average.state_dict().items()}
    write_checkpoint(folder, FORMAT, ("step", step, 7), {"identity": identity, "losses": losses}, tensors)


def restore_run(
    folder: Path, identity: dict[str, Any], network: nn.Module, average: nn.Module, optimizer: torch.optim.Optimizer
) -> tuple[int, list[float]]:
    """Read the latest checkpoint into the three; returns the steps done, and the losses of their unreported round.

    Raises:
        RaucaError: none or a damaged one, or one of a run made under other conditions, which are named.
    """
    fields = read_json(folder / POINTER)
    fields.format(*FORMAT, oldest=FORMAT[1])
    step, tensors = fields.integer("step"), read_tensors(folder, fields, OTHER_RUN)
    found = fields.raw("identity")
    losses = fields.array("losses", (max(1, len(fields.items("losses"))),)).tolist()
    fields.done()
    if changed := differences(found, identity):
        raise RaucaError(f"{folder}: holds a training with another {', '.join(changed)}; use the same, or {OTHER_RUN}")
    restore(network, optimizer, tensors, folder)
    try:
        average.load_state_dict({n.removeprefix(_MEAN): t for n, t in tensors.items() if n.startswith(_MEAN)})
    except RuntimeError as error:
        raise RaucaError(f"{folder}: a checkpoint of another network; {OTHER_RUN}") from error
    return step, losses
