"""Checkpoints of a training: network, optimiser and errors so far; a killed run goes on to the same bits."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import safetensors.torch
import torch
from safetensors import SafetensorError
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.files import sweep_partials, write_bytes, write_json
from ..contract.schema import read_json

FORMAT = ("rauca-efe-checkpoint", 1)
POINTER = "checkpoint.json"
OTHER_RUN = "start the training in a new folder"


@dataclass(frozen=True, eq=False)
class TrainingState:
    """A training after ``epoch`` epochs.

    Random streams are functions of the seed, the epoch and the step, so there is no generator state to keep.

    Attributes:
        errors: mean absolute test error S_0 ... S_epoch.
        identity: what the run depends on, as JSON.
        tensors: the network's as ``net.*``, the optimiser's as ``optimiser.<parameter>.<name>``.
    """

    epoch: int
    errors: list[float]
    identity: dict[str, Any]
    tensors: dict[str, Tensor]


def state_tensors(net: nn.Module, optimiser: torch.optim.Optimizer) -> dict[str, Tensor]:
    """Everything that a step changes."""
    tensors = {f"net.{name}": value for name, value in net.state_dict().items()}
    for number, entries in optimiser.state_dict()["state"].items():
        tensors |= {f"optimiser.{number}.{name}": torch.as_tensor(value) for name, value in entries.items()}
    return tensors


def restore(net: nn.Module, optimiser: torch.optim.Optimizer, tensors: dict[str, Tensor], where: Path) -> None:
    """Put saved tensors back; raises :class:`RaucaError` when they are another network's."""
    weights = {name[4:]: value for name, value in tensors.items() if name.startswith("net.")}
    state: dict[int, dict[str, Tensor]] = {}
    for name, value in tensors.items():
        if name.startswith("optimiser."):
            _, number, entry = name.split(".", 2)
            state.setdefault(int(number), {})[entry] = value
    try:
        net.load_state_dict(weights)
        optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})
    except (RuntimeError, ValueError, KeyError) as error:
        raise RaucaError(f"{where}: a checkpoint of another network; {OTHER_RUN}") from error


def save_state(folder: Path, state: TrainingState) -> None:
    """Write the tensors under a name of their own, then the JSON that points at them: readers never meet a mix."""
    name, version = FORMAT
    file = f"epoch-{state.epoch:05d}.safetensors"
    tensors = {k: v.detach().cpu().contiguous() for k, v in state.tensors.items()}
    write_bytes(folder / file, safetensors.torch.save(tensors))
    fields = {"format": name, "version": version, "epoch": state.epoch, "errors": state.errors, "tensors": file}
    write_json(folder / POINTER, {**fields, "identity": state.identity})
    for old in folder.glob("epoch-*.safetensors"):
        if old.name != file:
            old.unlink()
    sweep_partials(folder)


def load_state(folder: Path, identity: dict[str, Any]) -> TrainingState:
    """Read the latest checkpoint.

    Raises:
        RaucaError: none or a damaged one, or one of a run made under other conditions, which are named.
    """
    fields = read_json(folder / POINTER)
    fields.format(*FORMAT)
    epoch, path = fields.integer("epoch"), folder / fields.file_name("tensors")
    errors = fields.array("errors", (epoch + 1,)).tolist()
    found = fields.raw("identity")
    fields.done()
    changed = [k for k in sorted({*found, *identity}) if found.get(k) != identity.get(k)]
    if changed:
        raise RaucaError(f"{folder}: holds a training with another {', '.join(changed)}; use the same, or {OTHER_RUN}")
    try:
        tensors = safetensors.torch.load(path.read_bytes())
    except (OSError, SafetensorError) as error:
        raise RaucaError(f"{path}: missing or damaged ({error}); {OTHER_RUN}") from error
    return TrainingState(epoch, errors, found, tensors)
