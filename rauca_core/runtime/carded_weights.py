"""Weights that rauca trains: a safetensors file, and beside it the card that names its sha256."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import safetensors.torch
import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.files import write_bytes, write_json
from ..contract.reading import read_limited
from .checkpoint_files import MAX_TENSOR_BYTES, TENSOR_DAMAGE

Network = TypeVar("Network", bound=nn.Module)


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
