"""Detectors of our own behind the common interface, and on disk: a safetensors file in half precision with a card."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any

from torch import Tensor, nn

from ...contract import RaucaError
from ...contract.schema import Fields, Record, read_json
from ...runtime.tensor_files import load_carded, save_carded
from ...version import __version__
from ..batch_norm import freeze_batch_norms
from ..classes import unusual_names
from ..families import Resolved
from ..interface import DensePredictions
from ..letterbox import Letterbox
from ..nms import SinglePassDetector
from .networks import RECIPES, build_network, is_darknet


class SynthDetector(SinglePassDetector):
    """A trained network behind :class:`rauca_core.detect.Detector`.

    Objectness is one everywhere: the class probabilities already say whether anything is there.

    Attributes:
        size: the network's square input, pixels.
    """

    def __init__(
        self, name: str, network: nn.Module, class_names: tuple[str, ...], size: int, fingerprint: str = ""
    ) -> None:
        self.name, self.class_names, self.size, self.fingerprint = name, class_names, size, fingerprint
        self.network = network

    def _predict(self, images: Tensor) -> DensePredictions:
        box = Letterbox(images.shape[2], images.shape[3], self.size)
        return box.predict(images, self.network.dense)


MAX_CLASSES = 10_000  # the network is built before its weights are read; LVIS, the longest list in use, has 1203
REMEDY = "train it again with `rauca detectors train`"
LICENCE = "Apache-2.0; the backbone began as YOLOv4-tiny's (public domain, darknet)"
CAUTION = (
    "Trained on this project's synthetic frames alone: not a COCO detector, and no judge of photographs. Its backbone "
    "began with YOLOv4-tiny's COCO weights, so attacks may transfer between the two more easily than between "
    "strangers. It saw plain paints only and is not hardened against anything."
)

HARDENED = (
    "Fine-tuned on this project's synthetic frames, in plain paint and in camouflage: what it gained was measured "
    "on renders of the vehicles that its card names, and on camouflages of the kind it was trained on."
)


@dataclass(frozen=True, eq=False)
class DetectorCard(Record):
    """Where weights come from and what they are good for.

    Attributes:
        name: of the network, a key of :data:`networks.RECIPES` or a darknet network of the catalogue.
        architecture, licence, caution: for people.
        class_names: in the network's order.
        size: the network's square input, pixels.
        backbone: sha256 of the weights that the backbone, or the whole network, began with.
        data: per data set: name, use, vehicle, frames, size, weathers, seed.
        command: that made them, folders by their last names.
        seed, steps, settings: of the training.
        cpu_minutes: that it took, tests included.
        metrics: on the test frames, see ``measure.Findings``.
        remarks: for people.
        rauca: version that wrote them.
        called: the detector's name in tables; ``name`` unless given.
        hardened: against what, for weights of `harden`.
    """

    FORMAT = ("rauca-detector-weights", 1)

    name: str
    class_names: tuple[str, ...]
    size: Annotated[int, (64, 2048)]
    architecture: str = ""
    licence: str = LICENCE
    caution: str = CAUTION
    backbone: str = ""
    data: Annotated[Sequence[dict[str, Any]], "items"] = ()
    command: str = ""
    seed: int = 0
    steps: int = 0
    settings: dict[str, Any] = field(default_factory=dict)
    cpu_minutes: Annotated[float, (0,)] = 0.0
    metrics: dict[str, Any] = field(default_factory=dict)
    remarks: str = ""
    rauca: str = __version__
    called: str = ""
    hardened: dict[str, Any] = field(default_factory=dict)

    def _check_whole(self, where: str) -> None:
        if self.called:  # files of detections bear it
            Fields({"called": self.called}, where).plain_name("called")


def save_weights(path: Path, network: nn.Module, card: DetectorCard) -> None:
    """Write weights and card; the card, which names the weights' sha256, comes last."""
    tensors = {name: _half(t) for name, t in network.state_dict().items()}
    save_carded(path, path.with_suffix(".json"), card.FORMAT, tensors, asdict(card))


def load(found: Resolved, size: int | None) -> SynthDetector:
    """Of weights with their card; the size is the card's."""
    return load_weights(found.files[0])


def load_weights(path: Path) -> SynthDetector:
    """The detector of a weights file and its card, ready to infer on the CPU.

    Raises:
        RaucaError: missing, damaged, or not what the card describes.
    """
    network, card, digest = load_network(path)
    settings = f"{digest} {card.name} {card.size}{unusual_names(card.class_names)}"
    fingerprint = hashlib.sha256(settings.encode()).hexdigest()
    return as_detector(card, freeze_batch_norms(network).requires_grad_(False), fingerprint)


def as_detector(card: DetectorCard, network: nn.Module, fingerprint: str = "") -> SynthDetector:
    """A network in evaluation mode as the detector that its card describes."""
    return SynthDetector(card.called or card.name, network, card.class_names, card.size, fingerprint)


def load_network(path: Path) -> tuple[nn.Module, DetectorCard, str]:
    """The network of a weights file, ready to learn on, its card, and the file's sha256; see :func:`load_weights`."""
    card, digest = read_card(path.with_suffix(".json"))
    return load_carded(lambda: build_network(card.name, len(card.class_names)), path, digest, REMEDY), card, digest


def read_card(path: Path) -> tuple[DetectorCard, str]:
    """The card of a network of our own and the sha256 of the weights it describes."""
    card, digest = read_any_card(path)
    if not (card.name in RECIPES or is_darknet(card.name)) or not card.class_names:
        known = ", ".join(RECIPES)
        raise RaucaError(f"{path}: must name one of {known} or a darknet network, and its classes; {REMEDY}")
    return card, digest


def read_any_card(path: Path) -> tuple[DetectorCard, str]:
    """The same, of whatever was trained, an ONNX file too."""
    if not path.is_file():
        raise RaucaError(f"{path}: the weights' card is missing; keep the two files together, or {REMEDY}")
    fields = read_json(path)
    digest, card = fields.text("sha256"), DetectorCard.from_json(fields)
    if len(card.class_names) > MAX_CLASSES:
        raise RaucaError(f"{path}: names {len(card.class_names)} classes; at most {MAX_CLASSES} are read; {REMEDY}")
    return card, digest


def _half(tensor: Tensor) -> Tensor:
    tensor = tensor.detach().cpu().contiguous()
    return tensor.half() if tensor.dtype.is_floating_point else tensor
