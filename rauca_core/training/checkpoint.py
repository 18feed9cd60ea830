"""Checkpoints of a training: network, running mean, optimizer; a killed run goes on to the same bits."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.schema import read_json
from ..runtime.checkpoint_files import POINTER, differences, read_tensors, write_checkpoint

FORMAT = ("rauca-training-checkpoint", 1)
OTHER_RUN = "start the training in a new folder"
_NET, _AVERAGE, _OPTIMIZER = "net.", "average.", "optimizer."


class Average(Protocol):
    """A running mean of a network's weights."""

    def update(self, steps: int) -> None:
        """Take the weights in after ``steps`` steps."""
        ...

    def tensors(self) -> dict[str, Tensor]:
        """For a checkpoint; their names begin with ``average.``."""
        ...

    def restore(self, tensors: dict[str, Tensor]) -> None:
        """Put back what :meth:`tensors` gave, found among others; raises RuntimeError where they do not fit."""
        ...


class AveragedCopy:
    """A copy of a network, its buffers too, that follows its weights by an exponential mean.

    Args:
        decay: weight of the past at every step, in [0, 1); early on it is less, as nothing is worth remembering yet.
        ahead: how many steps more than were taken count as taken, early on.

    Attributes:
        network: the copy, in evaluation mode.
    """

    def __init__(self, network: nn.Module, decay: float, ahead: int = 0) -> None:
        self._followed, self._decay, self._ahead = network, decay, ahead
        self.network = copy.deepcopy(network).eval().requires_grad_(False)

    @torch.no_grad()
    def update(self, steps: int) -> None:
        steps += self._ahead
        past = min(self._decay, steps / (9 + steps))
        followed = self._followed.state_dict().values()
        for mean, now in zip(self.network.state_dict().values(), followed, strict=True):
            if mean.dtype.is_floating_point:
                mean.lerp_(now, 1 - past)
            else:
                mean.copy_(now)

    def tensors(self) -> dict[str, Tensor]:
        return {_AVERAGE + name: value for name, value in self.network.state_dict().items()}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        self.network.load_state_dict(_named(tensors, _AVERAGE))


class Trained(Protocol):
    """All that a step changes."""

    @property
    def network(self) -> nn.Module:
        """What learns, on its device."""
        ...

    @property
    def optimizer(self) -> torch.optim.Optimizer:
        """Of its parameters."""
        ...

    @property
    def average(self) -> Average:
        """Of its weights: what is tested and kept."""
        ...


def save_run(folder: Path, identity: dict[str, Any], step: int, losses: list[float], trained: Trained) -> None:
    """Write everything that a step changes; the checkpoint before goes when this one is whole.

    Args:
        losses: of the steps since the last test.
    """
    tensors = {_NET + name: value for name, value in trained.network.state_dict().items()} | trained.average.tensors()
    for number, entries in trained.optimizer.state_dict()["state"].items():
        tensors |= {f"{_OPTIMIZER}{number}.{name}": torch.as_tensor(value) for name, value in entries.items()}
    write_checkpoint(folder, FORMAT, ("step", step, 7), {"identity": identity, "losses": losses}, tensors)


def restore_run(folder: Path, identity: dict[str, Any], trained: Trained) -> tuple[int, list[float]]:
    """Read the latest checkpoint back; returns the steps done, and the losses since the last test.

    Raises:
        RaucaError: none or a damaged one, or one of a run made under other conditions, which are named.
    """
    fields = read_json(folder / POINTER)
    fields.format(*FORMAT)
    step, tensors = fields.integer("step"), read_tensors(folder, fields, OTHER_RUN)
    found = fields.raw("identity")
    losses = fields.array("losses", (len(fields.items("losses")),)).tolist()
    fields.done()
    if changed := differences(found, identity):
        raise RaucaError(f"{folder}: holds a training with another {', '.join(changed)}; use the same, or {OTHER_RUN}")
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in _named(tensors, _OPTIMIZER).items():
        number, entry = name.split(".", 1)
        state.setdefault(int(number), {})[entry] = value
    groups = trained.optimizer.state_dict()["param_groups"]
    try:
        trained.network.load_state_dict(_named(tensors, _NET))
        trained.optimizer.load_state_dict({"state": state, "param_groups": groups})
        trained.average.restore(tensors)
    except (RuntimeError, ValueError, KeyError) as error:
        raise RaucaError(f"{folder}: a checkpoint of another network; {OTHER_RUN}") from error
    return step, losses


def _named(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
