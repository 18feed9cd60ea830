"""Weights that rauca trains: a safetensors file, and beside it the card that names its sha256."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import safetensors.torch
import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.files import write_bytes, write_json
from ..contract.reading import read_limited
from .checkpoint_files import MAX_TENSOR_BYTES


def save_carded(
    path: Path, card_path: Path, form: tuple[str, int], tensors: Mapping[str, Tensor], card: Mapping[str, Any]
) -> None:
    """Write weights and card; the card comes last, so that weights it does not know are never taken for its own.

    Args:
        form: name and version of the card's format.
    """
    data = safetensors.torch.save(dict(tensors))
    write_bytes(path, data)
    name, version = form
    digest = hashlib.sha256(data).hexdigest()
    write_json(card_path, {"format": name, "version": version, "sha256": digest, **card})


def read_carded(path: Path, sha256: str, remedy: str) -> bytes:
    """The weights file as its card describes it; raises :class:`RaucaError` when it is another."""
    data = read_limited(path, MAX_TENSOR_BYTES, "weights")
    if hashlib.sha256(data).hexdigest() != sha256:
        raise RaucaError(f"{path}: is not the file that its card describes; copy both again, or {remedy}")
    return data


def require_weights(build: Callable[[], nn.Module], data: bytes, path: Path, remedy: str) -> None:
    """Refuse a card whose network is larger than its file, before any of it is made. Weights are half floats at least.

    Raises:
        RaucaError: more parameters than the file can hold.
    """
    with torch.device("meta"):
        wanted = sum(parameter.numel() for parameter in build().parameters())
    if 2 * wanted > len(data):
        raise RaucaError(f"{path}: does not hold the {wanted} parameters that its card describes; {remedy}")
