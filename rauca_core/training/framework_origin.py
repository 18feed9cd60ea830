"""A hardening that begins with a model of torchvision, transformers or MMDetection, and ends in one that they load."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import nn

from ..contract import RaucaError
from ..contract.files import file_digest
from ..detect.classes import class_index
from ..detect.families import FAMILIES, Resolved
from ..detect.foreign import first_line
from ..detect.frameworks.writing import write_mmdet, write_torchvision, write_transformers
from ..detect.interface import Detector
from ..detect.synth.card import DetectorCard
from ..detect.synth.framework_student import FrameworkStudent
from ..detect.synth.network import Truth
from ..runtime.tensor_files import write_card
from .measure import CAR
from .origin import ELSEWHERE, Origin

FRAMEWORKS = {"torchvision": write_torchvision, "transformers": write_transformers, "mmdet": write_mmdet}
"""The families that learn so, and what writes each."""
FRAMEWORK_LR = 4e-4
LARGEST = 640  # pixels, of the square images to learn from; the model scales them to its own size


@dataclass(frozen=True)
class FrameworkOrigin(Origin):
    """A framework's model to harden.

    Attributes:
        found: its file or folder, first of ``found.files``.
    """

    found: Resolved

    @property
    def suffix(self) -> str:
        """Of a file that is the suffix of what was given; a folder has none."""
        given = self.found.files[0]
        return "" if given.is_dir() else ".safetensors" if given.suffix == ".safetensors" else ".pth"

    def network(self, weights: Path | None = None) -> tuple[nn.Module, DetectorCard]:
        """The model ready to learn on: as it began, or with ``weights`` of an earlier round."""
        begun = _open(self.found if weights is None else self._as(weights))
        return FrameworkStudent(begun, _open(self.found)), self.card

    def detecting(self, network: nn.Module) -> Detector:
        assert isinstance(network, FrameworkStudent)
        return network.detector

    def opened(self, weights: Path) -> Detector:
        found: Detector = _open(self._as(weights))
        return found

    def save(self, path: Path, network: nn.Module, card: DetectorCard) -> None:
        """Write the model as it was read, with the network's weights; the card comes last.

        Raises:
            RaucaError: what was written is read as something else.
        """
        assert isinstance(network, FrameworkStudent)
        state = network.learnt() if self.found.family == "transformers" else network.detector.network.state_dict()
        held = FRAMEWORKS[self.found.family](self.found.files[0], path, state, card.class_names)
        again = dict(_open(self._as(path)).network.named_parameters())
        for name, value in network.learnt().items():
            if not torch.equal(again[name], value.cpu()):
                raise RaucaError(f"{held}: tensor {name} is read as others than were written; please report the model")
        write_card(path.with_suffix(".json"), card.FORMAT, held.read_bytes(), asdict(card))

    def _as(self, weights: Path) -> Resolved:
        return replace(self.found, name=weights.stem, files=(weights, *self.found.files[1:]))


def framework_origin(given: str, found: Resolved) -> FrameworkOrigin:
    """What can be hardened of the frameworks' models: those that know cars and whose own losses can be computed.

    Raises:
        RaucaError: another model; the line says why, and the way around.
    """
    detector, path = _open(found), found.files[0]
    label, fingerprint = class_index(detector, CAR), detector.fingerprint
    _try(given, detector, label)
    held = sorted(path.glob("*.safetensors")) + sorted(path.glob("*.pth")) if path.is_dir() else [path]
    side = max(64, min(LARGEST, detector.side) // 2 * 2)
    kind = f"{type(detector.network).__name__} of {found.family}"
    card = DetectorCard(
        found.name.replace(".", "-"), detector.class_names, side, kind, f"that of {path.name}, which it was made from"
    )
    return FrameworkOrigin(given, path, file_digest(held[0]), card, FRAMEWORK_LR, fingerprint, found)


def _try(given: str, detector: Any, label: int) -> None:
    """Compute the losses of one car once; the detector is of no use afterwards."""
    student = FrameworkStudent(detector, detector)
    student.train()
    car = Truth(torch.tensor([[16.0, 24.0, 48.0, 48.0]]), torch.tensor([label]))
    try:
        with torch.random.fork_rng(devices=[]):
            found = torch.stack(list(detector.losses(torch.full((1, 3, 64, 64), 0.5), [car]).values())).sum()
    except Exception as error:  # whatever a framework makes of a model that was not made to learn
        raise RaucaError(
            f"{given}: cannot be trained; its own losses fail ({first_line(error)}); {ELSEWHERE}"
        ) from error
    if not student.names or not found.requires_grad:
        raise RaucaError(f"{given}: cannot be trained; nothing in it learns; {ELSEWHERE}")


def _open(found: Resolved) -> Any:
    return FAMILIES[found.family].load(found, None)
