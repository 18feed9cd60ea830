"""Weights of extractors on disk: a safetensors file, and beside it a model card that says where they come from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

from torch import nn

from ..contract import RaucaError
from ..contract.assets import assets_folder
from ..contract.schema import Record, read_json
from ..runtime.tensor_files import load_carded, save_carded
from ..version import __version__
from .extractor import WIDTHS, LightSplitter, PublishedEfe

SHIPPED = Path("environment") / "light-splitter.safetensors"


@dataclass(frozen=True)
class Card(Record):
    """Where weights come from.

    Attributes:
        widths: of the network, channels per level.
        settings: of the training.
    """

    REMEDY: ClassVar[str] = ""
    WIDTH: ClassVar[range] = range(1, 4097)

    widths: Annotated[Sequence[int], "items"] = ()
    settings: dict[str, Any] = field(default_factory=dict)

    def _check_whole(self, where: str) -> None:
        allowed = self.WIDTH
        if not 2 <= len(self.widths) <= 8:
            raise RaucaError(f"{where}: widths must name 2 to 8 levels, not {len(self.widths)}; {self.REMEDY}")
        for width in self._all_widths():
            if type(width) is not int or width not in allowed:
                wanted = f"a multiple of {allowed.step} between {allowed.start} and {allowed[-1]}"
                raise RaucaError(f"{where}: a width must be {wanted}, not {width!r}; {self.REMEDY}")

    def _all_widths(self) -> list[int]:
        return list(self.widths)


@dataclass(frozen=True)
class ModelCard(Card):
    """The card of a `LightSplitter`.

    Attributes:
        widths, detail: of the network.
        data: per data set: name, vehicle, weathers, frames, size.
        command: that made them, folders by their last names.
        seed: names every random stream of the training.
        epochs: trained for.
        metrics: on held-out frames per weather, and over ``all``: psnr_db, mse, mae, bce.
        remarks: for people.
        rauca: version that wrote them.
    """

    FORMAT = ("rauca-efe-weights", 1)
    REMEDY = "train it again with `rauca efe train`"
    WIDTH = range(4, 1025, 4)

    widths: Annotated[Sequence[int], "items"] = (24, 40, 64, 96)
    detail: int = 12
    data: Annotated[Sequence[dict[str, Any]], "items"] = ()
    command: str = ""
    seed: int = 0
    epochs: int = 0
    metrics: dict[str, Any] = field(default_factory=dict)
    remarks: str = ""
    rauca: str = __version__

    def _all_widths(self) -> list[int]:
        return [*self.widths, self.detail]


@dataclass(frozen=True)
class PublishedCard(Card):
    """The card of a `PublishedEfe`.

    Attributes:
        data: the data set's name, frames trained on, size.
        error: mean absolute error on held-out frames, sRGB values.
    """

    FORMAT = ("rauca-published-efe-weights", 1)
    REMEDY = "train it again with `rauca efe published`"

    widths: Annotated[Sequence[int], "items"] = WIDTHS
    data: dict[str, Any] = field(default_factory=dict)
    error: float = 0.0


AnyCard = TypeVar("AnyCard", bound=Card)
Net = TypeVar("Net", bound=nn.Module)


def shipped_weights() -> Path:
    """The weights that rauca brings."""
    return assets_folder() / SHIPPED


def save_extractor(path: Path, net: nn.Module, card: Card) -> None:
    """Write weights and card; the card, which names the weights' sha256, comes last."""
    assert card.FORMAT is not None
    save_carded(path, path.with_suffix(".json"), card.FORMAT, net.state_dict(), card.to_json())


def load_extractor(path: Path | None = None) -> tuple[LightSplitter, ModelCard]:
    """Read weights, by default those that rauca ships; the network is ready to infer on the CPU.

    Raises:
        RaucaError: missing, damaged, or not what their card describes.
    """
    path = shipped_weights() if path is None else Path(path)
    return _load(path, ModelCard, lambda card: LightSplitter(tuple(card.widths), card.detail))


def load_published(path: Path) -> PublishedEfe:
    """Read weights of the published extractor; as :func:`load_extractor`."""
    return _load(path, PublishedCard, lambda card: PublishedEfe(tuple(card.widths)))[0]


def read_card(weights: Path, kind: type[AnyCard]) -> tuple[AnyCard, str]:
    """The card of weights, and the sha256 of the weights it describes."""
    path = weights.with_suffix(".json")
    if not path.is_file():
        raise RaucaError(f"{path}: the weights' model card is missing; keep the two files together")
    fields = read_json(path)
    digest = fields.text("sha256")
    return kind.from_json(fields), digest


def _load(path: Path, kind: type[AnyCard], build: Callable[[AnyCard], Net]) -> tuple[Net, AnyCard]:
    if not path.is_file():
        raise RaucaError(f"{path}: no such weights; {kind.REMEDY}")
    card, digest = read_card(path, kind)
    return load_carded(lambda: build(card), path, digest, kind.REMEDY).eval(), card
