"""Checkpoints: a run that was stopped goes on as if it had not been."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torch import Tensor

from ..contract import RaucaError
from ..contract.schema import read_json
from ..runtime.checkpoint_files import POINTER, differences, read_tensors, write_checkpoint

FORMAT = ("rauca-checkpoint", 2)
OTHER_RUN = "start the run in a new folder"
_TENSORS = ("parameter", "exp_avg", "exp_avg_sq", "adam_step", "order", "next")


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A run after ``step`` steps.

    Random streams are functions of the seed and the step, so there is no generator state to keep. The frames
    of the next step are drawn already: they are loaded while the step before them works.

    Attributes:
        step: steps done.
        identity: what the run depends on (settings, data set, vehicle, detector), as JSON.
        tensors: the texture's ``parameter``; Adam's ``exp_avg`` and ``exp_avg_sq`` of its shape, ``adam_step`` ();
            ``order``, see ``FrameOrder.state``; ``next`` (B,), the frames of the next step.
    """

    step: int
    identity: dict[str, Any]
    tensors: dict[str, Tensor]


def save_checkpoint(folder: Path, checkpoint: Checkpoint) -> None:
    """Write it; the one before goes when this one is whole."""
    fields = {"identity": checkpoint.identity}
    write_checkpoint(folder, FORMAT, ("step", checkpoint.step, 8), fields, checkpoint.tensors)


def load_checkpoint(folder: Path) -> Checkpoint:
    """Read the latest checkpoint; raises :class:`RaucaError` when there is none or it is damaged."""
    fields = read_json(folder / POINTER)
    fields.format(*FORMAT)
    step, identity = fields.integer("step"), fields.raw("identity")
    tensors = read_tensors(folder, fields, OTHER_RUN)
    fields.done()
    if set(tensors) != set(_TENSORS):
        raise RaucaError(f"{folder / POINTER}: not a checkpoint of this rauca; {OTHER_RUN}")
    return Checkpoint(step, identity, tensors)


def check_identity(folder: Path, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Refuse to resume a run under other conditions, naming what differs."""
    if changed := differences(found, wanted):
        raise RaucaError(
            f"{folder}: holds a run made with another {', '.join(changed)}; use the same or another output folder"
        )
