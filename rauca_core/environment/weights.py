"""Weights of our extractor on disk: a safetensors file, and beside it a model card that says where they come from."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.assets import assets_folder
from ..contract.schema import Fields, read_json
from ..runtime.carded_weights import load_carded, save_carded
from ..version import __version__
from .extractor import LightSplitter

FORMAT = ("rauca-efe-weights", 1)
SHIPPED = Path("environment") / "light-splitter.safetensors"
REMEDY = "train it again with `rauca efe train`"


@dataclass(frozen=True)
class ModelCard:
    """Where weights come from.

    Attributes:
        widths, detail: of the network.
        data: per data set: name, vehicle, weathers, frames, size.
        command: that made them, folders by their last names.
        seed: names every random stream of the training.
        epochs: trained for.
        settings: of the training.
        metrics: on held-out frames per weather, and over ``all``: psnr_db, mse, mae, bce.
        remarks: for people.
        rauca: version that wrote them.
    """

    widths: tuple[int, ...] = (24, 40, 64, 96)
    detail: int = 12
    data: list[dict[str, Any]] = field(default_factory=list)
    command: str = ""
    seed: int = 0
    epochs: int = 0
    settings: dict[str, Any] = field(default_factory=dict)
    metrics: dict[str, dict[str, float]] = field(default_factory=dict)
    remarks: str = ""
    rauca: str = __version__


def shipped_weights() -> Path:
    """The weights that rauca brings."""
    return assets_folder() / SHIPPED


def card_path(weights: Path) -> Path:
    return weights.with_suffix(".json")


def save_extractor(path: Path, net: nn.Module, card: ModelCard) -> None:
    """Write weights and card; the card, which names the weights' sha256, comes last."""
    tensors: dict[str, Tensor] = {k: v.detach().cpu().contiguous() for k, v in net.state_dict().items()}
    save_carded(path, card_path(path), FORMAT, tensors, asdict(card))


def load_extractor(path: Path | None = None) -> tuple[LightSplitter, ModelCard]:
    """Read weights, by default those that rauca ships; the network is ready to infer on the CPU.

    Raises:
        RaucaError: missing, damaged, or not what their card describes.
    """
    path = shipped_weights() if path is None else Path(path)
    card, digest = read_card(card_path(path))
    return load_carded(lambda: LightSplitter(card.widths, card.detail), path, digest, REMEDY).eval(), card


def read_card(path: Path) -> tuple[ModelCard, str]:
    """The model card and the sha256 of the weights it describes."""
    if not path.is_file():
        raise RaucaError(f"{path}: the weights' model card is missing; keep the two files together")
    fields = read_json(path)
    fields.format(*FORMAT)
    digest = fields.text("sha256")
    widths = tuple(_width(path, w) for w in fields.items("widths"))
    card = ModelCard(
        widths=widths,
        detail=_width(path, fields.raw("detail")),
        data=list(fields.items("data")),
        command=fields.text("command"),
        seed=fields.integer("seed"),
        epochs=fields.integer("epochs"),
        settings=_object(fields, "settings"),
        metrics=_object(fields, "metrics"),
        remarks=fields.text("remarks"),
        rauca=fields.text("rauca"),
    )
    fields.done()
    if not 2 <= len(widths) <= 8:
        raise RaucaError(f"{path}: widths must name 2 to 8 levels, not {len(widths)}; {REMEDY}")
    return card, digest


def parameters(net: nn.Module) -> int:
    """How many numbers a network learns."""
    return sum(p.numel() for p in net.parameters())


def _width(path: Path, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 4 <= value <= 1024 or value % 4:
        raise RaucaError(f"{path}: a width must be a multiple of 4 between 4 and 1024, not {value!r}; {REMEDY}")
    return value


def _object(fields: Fields, name: str) -> dict[str, Any]:
    value = fields.raw(name)
    if not isinstance(value, dict):
        raise RaucaError(f"{fields.where}: {name} must be a JSON object; {REMEDY}")
    return value
