"""The detector that a hardening begins with, as a network that can learn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from torch import nn

from ..contract import RaucaError
from ..contract.files import file_digest
from ..detect.catalogue import SOURCES, find_source
from ..detect.classes import class_list
from ..detect.darknet import read_weights
from ..detect.interface import Detector
from ..detect.load import load_detector, resolve
from ..detect.synth.card import DetectorCard, load_network, read_card
from ..detect.synth.darknet_student import DarknetStudent
from ..detect.synth.networks import RECIPES, is_darknet

DARKNET_SIZE, DARKNET_LR = 416, 4e-4


@dataclass(frozen=True)
class Origin:
    """A detector to harden.

    Attributes:
        given: as the user named it.
        weights: its file, whose sha256 is ``sha256``.
        card: that of detectors of our own; for a darknet network one that only says what it is.
        lr: the learning rate that suits its first training.
        fingerprint: the detector's, see ``interface.Detector``.
    """

    given: str
    weights: Path
    sha256: str
    card: DetectorCard
    lr: float
    fingerprint: str

    def detector(self) -> Detector:
        """The detector before it is hardened."""
        return load_detector(self.given)

    def network(self, weights: Path | None = None) -> tuple[nn.Module, DetectorCard]:
        """The network ready to learn on, and its card: as it began, or with ``weights`` of a hardening."""
        network, card = self._first() if weights is None else load_network(weights)[:2]
        if isinstance(network, DarknetStudent):
            before, _ = self._first()
            assert isinstance(before, DarknetStudent)
            network.remember(before.network)
        return network, card

    def _first(self) -> tuple[nn.Module, DetectorCard]:
        if self.weights.suffix != ".weights":
            return load_network(self.weights)[:2]
        student = DarknetStudent(find_source(self.card.name).cfg)
        read_weights(self.weights, student.network)
        return student, self.card


def origin_of(detector: str) -> Origin:
    """What can be hardened: our own detectors, darknet networks, and what was hardened before.

    Raises:
        RaucaError: another kind of detector, or missing or damaged files.
    """
    source = SOURCES.get(detector.partition("=")[0])
    if source is not None and source.family not in ("synth", "darknet"):
        raise _refusal(detector)  # before its weights are asked for
    found = resolve(detector)
    weights, fingerprint = found.files[0], load_detector(detector).fingerprint
    if found.family == "synth":
        card, digest = read_card(weights.with_suffix(".json"))
        lr = RECIPES[card.name].lr if card.name in RECIPES else DARKNET_LR
        return Origin(detector, weights, digest, card, lr, fingerprint)
    if found.family == "darknet" and is_darknet(found.name) and found.network:
        card = DetectorCard(
            found.name, class_list("coco-80"), DARKNET_SIZE, f"{found.name} of darknet", "public domain"
        )
        return Origin(detector, weights, file_digest(weights), card, DARKNET_LR, fingerprint)
    raise _refusal(detector)


def _refusal(detector: str) -> RaucaError:
    return RaucaError(
        f"{detector}: rauca hardens its own detectors ({', '.join(RECIPES)}), darknet networks with a name, such as "
        "yolov3-tiny, and what it hardened before; choose one of these"
    )
