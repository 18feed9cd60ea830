"""Tensors on disk, under the sha256 that a JSON beside them names: weights with their card, checkpoints of a run.

With a checkpoint a run that was stopped or killed goes on as if it had not been: tensors lie under a name of their own,
and a JSON points at the latest, so that readers never meet a mix.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import safetensors.torch
import torch
from safetensors import SafetensorError
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.files import sweep_partials, write_bytes, write_json
from ..contract.reading import read_limited
from ..contract.schema import read_json
from .distributed import Processes
from .folder_lock import alone_in

CHECKPOINTS, POINTER = "checkpoints", "checkpoint.json"
FORMAT = ("rauca-checkpoint", 2)
MAX_TENSOR_BYTES = 2**32  # the largest: a hardened YOLOv3 with its average and Adam's two moments, 1 GB
# Of safetensors: its own, of a header that is no text, of a type that torch does not have, of a tensor beyond memory.
TENSOR_DAMAGE = (SafetensorError, ValueError, KeyError, TypeError, RuntimeError, OverflowError, MemoryError)
Network = TypeVar("Network", bound=nn.Module)


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


@contextlib.contextmanager
def held_run(out: Path, processes: Processes) -> Iterator[bool]:
    """Hold the folder of a run that processes share, and tell all of them alike whether it has a checkpoint.

    The one that writes decides, and all wait for it: its first checkpoint may be there before another has looked.

    Raises:
        RaucaError: another run is at work there, or the folder cannot be written to.
    """
    with alone_in(out) if processes.is_main else contextlib.nullcontext():
        yield processes.any(processes.is_main and started(out))


def save_checkpoint(folder: Path, checkpoint: Checkpoint) -> None:
    """Write it; the one before goes when this one is whole."""
    file = f"step-{checkpoint.step:08d}.safetensors"
    told = {"step": checkpoint.step, "tensors": file, "identity": checkpoint.identity}
    save_carded(folder / file, folder / POINTER, FORMAT, checkpoint.tensors, told)
    for old in folder.glob("step-*.safetensors"):
        if old.name != file:
            old.unlink()
    sweep_partials(folder)


def load_checkpoint(folder: Path) -> Checkpoint:
    """Read the latest checkpoint; raises :class:`RaucaError` when there is none or it is damaged."""
    fields = read_json(folder / POINTER)
    fields.format(*FORMAT)
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


def require_same(folder: Path, what: str, found: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Refuse to go on with a run under other conditions, naming what differs; ``what`` is it called."""
    changed = ["identity"]
    if isinstance(found, dict):  # it is as the file has it
        changed = [key for key in sorted({*found, *wanted}) if found.get(key) != wanted.get(key)]
    if changed:
        raise RaucaError(
            f"{folder}: holds a {what} with another {', '.join(changed)}; use the same, or start in a new folder"
        )


def save_carded(
    path: Path, card_path: Path, form: tuple[str, int], tensors: Mapping[str, Tensor], card: Mapping[str, Any]
) -> None:
    """Write weights and card; the card comes last, so that weights it does not know are never taken for its own.

    Args:
        form: name and version of the card's format.
    """
    data = safetensors.torch.save({name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()})
    write_bytes(path, data)
    write_card(card_path, form, data, card)


def write_card(card_path: Path, form: tuple[str, int], data: bytes, card: Mapping[str, Any]) -> None:
    """Write the card of a file of weights with the bytes ``data``."""
    name, version = form
    digest = hashlib.sha256(data).hexdigest()
    write_json(card_path, {"format": name, "version": version, "sha256": digest, **card})


def load_carded(build: Callable[[], Network], path: Path, sha256: str, remedy: str) -> Network:
    """The network that a card describes, on the CPU, with its weights.

    Raises:
        RaucaError: no weights; others than those of the card; a network larger than its file (found before any of it is
            made); weights that do not fit, or are not finite.
    """
    if not path.is_file():
        raise RaucaError(f"{path}: no such weights; {remedy}")
    data = read_limited(path, MAX_TENSOR_BYTES, "weights")
    if hashlib.sha256(data).hexdigest() != sha256:
        raise RaucaError(f"{path}: is not the file that its card describes; copy both again, or {remedy}")
    with torch.device("meta"):
        wanted = sum(parameter.numel() for parameter in build().parameters())
    if 2 * wanted > len(data):  # half floats at least
        raise RaucaError(f"{path}: does not hold the {wanted} parameters that its card describes; {remedy}")
    network = build()
    try:
        network.load_state_dict(safetensors.torch.load(data))
    except TENSOR_DAMAGE as error:
        raise RaucaError(f"{path}: does not hold the network that its card describes; {remedy}") from error
    if not all(tensor.isfinite().all() for tensor in network.state_dict().values()):
        raise RaucaError(f"{path}: holds NaN or infinity; {remedy}")
    return network
