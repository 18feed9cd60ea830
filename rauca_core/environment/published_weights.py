"""Weights of the published extractor on disk, trained here: the paper's own are not public."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import safetensors.torch

from ..contract import RaucaError
from ..contract.schema import read_json
from ..runtime.carded_weights import read_carded, require_weights, save_carded
from ..runtime.checkpoint_files import TENSOR_DAMAGE
from .published import PublishedEfe

FORMAT = ("rauca-published-efe-weights", 1)
REMEDY = "train it again with `rauca ablate environment`"


@dataclass(frozen=True)
class PublishedCard:
    """Where weights come from.

    Attributes:
        widths: of the network.
        data: the data set's name, frames trained on, size.
        settings: of the training.
        error: mean absolute error on held-out frames, sRGB values.
    """

    widths: tuple[int, ...]
    data: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    error: float = 0.0


def save_published(path: Path, net: PublishedEfe, card: PublishedCard) -> None:
    """Write weights and card (.json beside them)."""
    tensors = {name: value.detach().cpu().contiguous() for name, value in net.state_dict().items()}
    save_carded(path, path.with_suffix(".json"), FORMAT, tensors, asdict(card))


def load_published(path: Path) -> PublishedEfe:
    """Read weights; the network is ready to infer on the CPU.

    Raises:
        RaucaError: missing, damaged, or not what their card describes.
    """
    card = path.with_suffix(".json")
    if not path.is_file() or not card.is_file():
        raise RaucaError(f"{path}: no such weights with a card; {REMEDY}")
    fields = read_json(card)
    fields.format(*FORMAT)
    widths, data = fields.items("widths"), read_carded(path, fields.text("sha256"), REMEDY)
    if not 2 <= len(widths) <= 8 or not all(type(w) is int and 1 <= w <= 4096 for w in widths):
        raise RaucaError(f"{card}: widths must be 2 to 8 whole numbers up to 4096; {REMEDY}")
    require_weights(lambda: PublishedEfe(tuple(widths)), data, path, REMEDY)
    net = PublishedEfe(tuple(widths))
    try:
        net.load_state_dict(safetensors.torch.load(data))
    except TENSOR_DAMAGE as error:
        raise RaucaError(f"{path}: does not hold the network that its card describes; {REMEDY}") from error
    return net.eval()
