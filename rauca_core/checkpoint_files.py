"""A checkpoint's files: tensors under a name of their own, and a JSON that points at the latest."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import safetensors.torch
from safetensors import SafetensorError
from torch import Tensor

from .contract import RaucaError
from .contract.files import sweep_partials, write_bytes, write_json

POINTER = "checkpoint.json"


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
    write_bytes(folder / file, safetensors.torch.save(kept))
    opening = {"format": name, "version": version, counted: done}
    write_json(folder / POINTER, {**opening, "tensors": file, **fields})
    for old in folder.glob(f"{counted}-*.safetensors"):
        if old.name != file:
            old.unlink()
    sweep_partials(folder)


def read_tensors(path: Path, remedy: str) -> dict[str, Tensor]:
    """Tensors of a checkpoint; raises :class:`RaucaError` with the ``remedy`` when they are missing or damaged."""
    try:
        tensors: dict[str, Tensor] = safetensors.torch.load(path.read_bytes())
    except (OSError, SafetensorError) as error:
        raise RaucaError(f"{path}: missing or damaged ({error}); {remedy}") from error
    return tensors


def differences(found: dict[str, Any], wanted: dict[str, Any]) -> list[str]:
    """Names of what a run depends on that differ between two identities."""
    return [key for key in sorted({*found, *wanted}) if found.get(key) != wanted.get(key)]
