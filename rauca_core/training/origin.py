"""The detector that a hardening begins with, as a network that can learn."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from torch import nn

from ..detect.catalogue import find_source
from ..detect.darknet import read_weights
from ..detect.interface import Detector
from ..detect.load import load_detector
from ..detect.synth.card import DetectorCard, as_detector, load_network, load_weights, save_weights
from ..detect.synth.darknet_student import DarknetStudent
from ..detect.synth.own_student import OwnStudent

ELSEWHERE = (
    "train it by its own trainer on `rauca dataset export DIR --format yolo --out OUT --camouflage FILE`, and measure "
    "with `rauca assess NEW --before OLD`"
)
"""The way out for what rauca cannot train."""


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

    @property
    def suffix(self) -> str:
        """Of the files that hold its hardened weights; none where that is a folder."""
        return ".safetensors"

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
        return OwnStudent(network, self.detector()), card

    def detecting(self, network: nn.Module) -> Detector:
        """The detector that a network of :meth:`network`'s is, in evaluation mode."""
        return as_detector(self.card, network)

    def opened(self, weights: Path) -> Detector:
        """The detector of weights that :meth:`save` wrote."""
        return load_weights(weights)

    def hardened_in(self, folder: Path) -> Path:
        """The weights that a hardening leaves in a folder, its card beside them."""
        return folder / f"hardened-{self.card.name}{self.suffix}"

    def save(self, path: Path, network: nn.Module, card: DetectorCard) -> None:
        """Write weights with their card, which comes last."""
        save_weights(path, network.network if isinstance(network, OwnStudent) else network, card)

    def _first(self) -> tuple[nn.Module, DetectorCard]:
        if self.weights.suffix != ".weights":
            return load_network(self.weights)[:2]
        student = DarknetStudent(find_source(self.card.name).cfg)
        read_weights(self.weights, student.network)
        return student, self.card
