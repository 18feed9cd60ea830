"""Checkpoints: a run that was stopped goes on as if it had not been."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import safetensors.torch
from safetensors import SafetensorError
from torch import Tensor

from ..contract import RaucaError
from ..contract.files import sweep_partials, write_bytes, write_json
from ..contract.schema import read_json

FORMAT = ("rauca-checkpoint", 1)
POINTER = "checkpoint.json"
_TENSORS = ("texels", "exp_avg", "exp_avg_sq", "adam_step")


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A run after ``step`` steps.

    Random streams are functions of the seed and the step, so there is no generator state to keep.

    Attributes:
        step: steps done.
        identity: what the run depends on (settings, data set, vehicle, detector), as JSON.
        tensors: ``texels`` (P, 3) sRGB, Adam's ``exp_avg``, ``exp_avg_sq`` (P, 3) and ``adam_step`` ().
    """

    step: int
    identity: dict[str, Any]
    tensors: dict[str, Tensor]


def save_checkpoint(folder: Path, checkpoint: Checkpoint) -> None:
    """Write the tensors under a name of their own, then the JSON that points at them: readers never meet a mix."""
    name, version = FORMAT
    file = f"step-{checkpoint.step:08d}.safetensors"
    tensors = {k: v.detach().cpu().contiguous() for k, v in checkpoint.tensors.items()}
    write_bytes(folder / file, safetensors.torch.save(tensors))
    fields = {"format": name, "version": version, "step": checkpoint.step, "tensors": file}
    write_json(folder / POINTER, {**fields, "identity": checkpoint.identity})
    for old in folder.glob("step-*.safetensors"):
        if old.name != file:
            old.unlink()
    sweep_partials(folder)


def load_checkpoint(folder: Path) -> Checkpoint:
    """Read the latest checkpoint; raises :class:`RaucaError` when there is none or it is damaged."""
    fields = read_json(folder / POINTER)
    fields.format(*FORMAT)
    step, path, identity = fields.integer("step"), folder / fields.file_name("tensors"), fields.raw("identity")
    fields.done()
    try:
        tensors = safetensors.torch.load(path.read_bytes())
    except (OSError, SafetensorError) as error:
        raise RaucaError(f"{path}: missing or damaged ({error}); start the run in a new folder") from error
    if set(tensors) != set(_TENSORS):
        raise RaucaError(f"{path}: not a checkpoint of this rauca; start the run in a new folder")
    return Checkpoint(step, identity, tensors)


def check_identity(folder: Path, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Refuse to resume a run under other conditions, naming what differs."""
    changed = [k for k in sorted({*found, *wanted}) if found.get(k) != wanted.get(k)]
    if changed:
        raise RaucaError(
            f"{folder}: holds a run made with another {', '.join(changed)}; use the same or another output folder"
        )
