"""A checkpoint's files: tensors under a name of their own, and a JSON that points at the latest."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import safetensors.torch
from safetensors import SafetensorError
from torch import Tensor

from ..contract import RaucaError
from ..contract.files import sweep_partials, write_bytes, write_json
from ..contract.reading import read_limited
from ..contract.schema import Fields

POINTER = "checkpoint.json"
MAX_TENSOR_BYTES = 2**32  # the largest: a hardened YOLOv3 with its average and Adam's two moments, 1 GB
# Of safetensors: its own, of a header that is no text, of a type that torch does not have, of a tensor beyond memory.
TENSOR_DAMAGE = (SafetensorError, ValueError, KeyError, TypeError, RuntimeError, OverflowError, MemoryError)


def write_checkpoint(
    folder: Path, form: tuple[str, int], count: tuple[str, int, int], fields: dict[str, Any], tensors: dict[str, Tensor]
) -> None:
    """Write the tensors, then the JSON that points at them, then remove older ones: readers never meet a mix.

    Args:
        form: name and version of the JSON's format.
        count: what is counted (``step``, ``epoch``), how many are done, and the digits that name the file.
        fields: what else the JSON holds.
    """
    (name, version), (counted, done, digits) = form, count
    file = f"{counted}-{done:0{digits}d}.safetensors"
    kept = {key: value.detach().cpu().contiguous() for key, value in tensors.items()}
    data = safetensors.torch.save(kept)
    write_bytes(folder / file, data)
    opening = {"format": name, "version": version, counted: done}
    digest = hashlib.sha256(data).hexdigest()
    write_json(folder / POINTER, {**opening, "tensors": file, "sha256": digest, **fields})
    for old in folder.glob(f"{counted}-*.safetensors"):
        if old.name != file:
            old.unlink()
    sweep_partials(folder)


def read_tensors(folder: Path, fields: Fields, remedy: str) -> dict[str, Tensor]:
    """Tensors of the checkpoint whose JSON is ``fields``.

    Raises:
        RaucaError: they are missing, damaged, or not the bytes that were written; with the ``remedy``.
    """
    path = folder / fields.file_name("tensors")
    digest = fields.text("sha256")
    try:
        data = read_limited(path, MAX_TENSOR_BYTES, "a checkpoint")
        if hashlib.sha256(data).hexdigest() != digest:
            raise RaucaError("its bytes are not those that were written")
        tensors: dict[str, Tensor] = safetensors.torch.load(data)
    except (RaucaError, *TENSOR_DAMAGE) as error:
        told = str(error).removeprefix(f"{path}: ")
        raise RaucaError(f"{path}: missing or damaged ({told}); {remedy}") from error
    return tensors


def differences(found: dict[str, Any], wanted: dict[str, Any]) -> list[str]:
    """Names of what a run depends on that differ between two identities; all of it when one is no such thing."""
    if not isinstance(found, dict):
        return ["identity"]
    return [key for key in sorted({*found, *wanted}) if found.get(key) != wanted.get(key)]
