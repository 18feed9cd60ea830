"""Checkpoints of a training: network, optimizer and errors so far; a killed run goes on to the same bits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.schema import read_json
from ..runtime.checkpoint_files import POINTER, differences, read_tensors, write_checkpoint

FORMAT = ("rauca-efe-checkpoint", 1)
OTHER_RUN = "start the training in a new folder"


@dataclass(frozen=True, eq=False)
class TrainingState:
    """A training after ``epoch`` epochs.

    Random streams are functions of the seed, the epoch and the step, so there is no generator state to keep.

    Attributes:
        errors: mean absolute test error S_0 ... S_epoch.
        identity: what the run depends on, as JSON.
        tensors: the network's as ``net.*``, the optimizer's as ``optimizer.<parameter>.<name>``, and the weights' mean
            as ``average.*``.
    """

    epoch: int
    errors: list[float]
    identity: dict[str, Any]
    tensors: dict[str, Tensor]


def state_tensors(net: nn.Module, optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    """Everything that a step changes."""
    tensors = {f"net.{name}": value for name, value in net.state_dict().items()}
    for number, entries in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{number}.{name}": torch.as_tensor(value) for name, value in entries.items()}
    return tensors


def restore(net: nn.Module, optimizer: torch.optim.Optimizer, tensors: dict[str, Tensor], where: Path) -> None:
    """Put saved tensors back; raises :class:`RaucaError` when they are another network's."""
    weights = {name[4:]: value for name, value in tensors.items() if name.startswith("net.")}
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        if name.startswith("optimizer."):
            _, number, entry = name.split(".", 2)
            state.setdefault(int(number), {})[entry] = value
    try:
        net.load_state_dict(weights)
        optimizer.load_state_dict({"state": state, "param_groups": optimizer.state_dict()["param_groups"]})
    except (RuntimeError, ValueError, KeyError) as error:
        raise RaucaError(f"{where}: a checkpoint of another network; {OTHER_RUN}") from error


def save_state(folder: Path, state: TrainingState) -> None:
    """Write it; the one before goes when this one is whole."""
    fields = {"errors": state.errors, "identity": state.identity}
    write_checkpoint(folder, FORMAT, ("epoch", state.epoch, 5), fields, state.tensors)


def load_state(folder: Path, identity: dict[str, Any]) -> TrainingState:
    """Read the latest checkpoint.

    Raises:
        RaucaError: none or a damaged one, or one of a run made under other conditions, which are named.
    """
    fields = read_json(folder / POINTER)
    fields.format(*FORMAT)
    epoch, tensors = fields.integer("epoch"), read_tensors(folder, fields, OTHER_RUN)
    errors = fields.array("errors", (epoch + 1,)).tolist()
    found = fields.raw("identity")
    fields.done()
    if changed := differences(found, identity):
        raise RaucaError(f"{folder}: holds a training with another {', '.join(changed)}; use the same, or {OTHER_RUN}")
    return TrainingState(epoch, errors, found, tensors)
