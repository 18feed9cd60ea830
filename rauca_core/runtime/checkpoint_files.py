"""Checkpoints: a run that was stopped or killed goes on as if it had not been.

Tensors lie under a name of their own, and a JSON points at the latest: readers never meet a mix.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import safetensors.torch
from safetensors import SafetensorError
from torch import Tensor

from ..contract import RaucaError
from ..contract.files import sweep_partials, write_bytes, write_json
from ..contract.reading import read_limited
from ..contract.schema import read_json

CHECKPOINTS, POINTER = "checkpoints", "checkpoint.json"
FORMAT, VERSION = "rauca-checkpoint", 2
MAX_TENSOR_BYTES = 2**32  # the largest: a hardened YOLOv3 with its average and Adam's two moments, 1 GB
# Of safetensors: its own, of a header that is no text, of a type that torch does not have, of a tensor beyond memory.
TENSOR_DAMAGE = (SafetensorError, ValueError, KeyError, TypeError, RuntimeError, OverflowError, MemoryError)


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A run after ``step`` steps.

    Random streams are functions of the seed and the step, so there is no generator state to keep.

    Attributes:
        identity: what the run depends on (settings, data sets, detectors), as JSON.
        tensors: all that a step changes.
    """

    step: int
    identity: dict[str, Any]
    tensors: dict[str, Tensor]


def started(out: Path) -> bool:
    """Whether the run in ``out`` has a checkpoint."""
    return (out / CHECKPOINTS / POINTER).is_file()


def require_state(out: Path, what: str, found: bool, resume: bool) -> None:
    """Refuse to start where a run is (``found``), and to resume where none is; ``what`` is it called."""
    if found != resume:
        hint = "resume it or choose another folder" if found else "start it without resuming"
        raise RaucaError(f"{out}: holds {'a' if found else 'no'} {what}; {hint}")


def save_checkpoint(folder: Path, checkpoint: Checkpoint) -> None:
    """Write it; the one before goes when this one is whole."""
    file = f"step-{checkpoint.step:08d}.safetensors"
    data = safetensors.torch.save({k: v.detach().cpu().contiguous() for k, v in checkpoint.tensors.items()})
    write_bytes(folder / file, data)
    opening = {"format": FORMAT, "version": VERSION, "step": checkpoint.step, "tensors": file}
    digest = hashlib.sha256(data).hexdigest()
    write_json(folder / POINTER, {**opening, "sha256": digest, "identity": checkpoint.identity})
    for old in folder.glob("step-*.safetensors"):
        if old.name != file:
            old.unlink()
    sweep_partials(folder)


def load_checkpoint(folder: Path) -> Checkpoint:
    """Read the latest checkpoint; raises :class:`RaucaError` when there is none or it is damaged."""
    fields = read_json(folder / POINTER)
    fields.format(FORMAT, VERSION)
    step, identity = fields.integer("step"), fields.raw("identity")
    path, digest = folder / fields.file_name("tensors"), fields.text("sha256")
    fields.done()
    try:
        data = read_limited(path, MAX_TENSOR_BYTES, "a checkpoint")
        if hashlib.sha256(data).hexdigest() != digest:
            raise RaucaError("its bytes are not those that were written")
        tensors: dict[str, Tensor] = safetensors.torch.load(data)
    except (RaucaError, *TENSOR_DAMAGE) as error:
        told = str(error).removeprefix(f"{path}: ")
        raise RaucaError(f"{path}: missing or damaged ({told}); start the run in a new folder") from error
    return Checkpoint(step, identity, tensors)


def differences(found: dict[str, Any], wanted: dict[str, Any]) -> list[str]:
    """Names of what a run depends on that differ between two identities; all of it when one is no such thing."""
    if not isinstance(found, dict):
        return ["identity"]
    return [key for key in sorted({*found, *wanted}) if found.get(key) != wanted.get(key)]


def require_same(folder: Path, what: str, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Refuse to resume a run under other conditions, naming what differs; ``what`` is it called."""
    if changed := differences(found, wanted):
        raise RaucaError(
            f"{folder}: holds a {what} with another {', '.join(changed)}; use the same, or start in a new folder"
        )
