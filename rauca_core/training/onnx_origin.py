"""A hardening that begins with an ONNX file and ends in one: the same graph with other weights."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import nn

from ..contract import RaucaError
from ..contract.files import file_digest, write_bytes
from ..detect.classes import class_index
from ..detect.families import FAMILIES, Resolved
from ..detect.foreign import extra
from ..detect.interface import Detector
from ..detect.load import resolve
from ..detect.onnx_detector import LARGEST_DIFFERENCE, OnnxDetector, largest_difference
from ..detect.onnx_graph import read_graph
from ..detect.onnx_weights import with_tensors
from ..detect.synth.card import HARDENED, DetectorCard
from ..detect.synth.onnx_student import OnnxStudent
from ..runtime.tensor_files import write_card
from .measure import CAR
from .origin import ELSEWHERE, Origin

if TYPE_CHECKING:
    from onnx import TensorProto

ONNX_LR = 4e-4


@dataclass(frozen=True)
class OnnxOrigin(Origin):
    """An ONNX file to harden; ``weights`` is the file, which a ``.names`` file may lie beside."""

    @property
    def suffix(self) -> str:
        return ".onnx"

    def network(self, weights: Path | None = None) -> tuple[nn.Module, DetectorCard]:
        """The graph ready to learn on: as it began, or with the weights of ``weights``, a file of the same graph."""
        student = OnnxStudent(_open(resolve(self.given)), read_graph(self.weights))
        if weights is not None:
            numbers = {one.name: one for one in read_graph(weights).model.graph.initializer}
            student.learn({name: _values(numbers[name]) for name in student.names})
        return student, self.card

    def opened(self, weights: Path) -> Detector:
        """The detector of a file that :meth:`save` wrote."""
        found = resolve(self.given)
        return _open(replace(found, name=weights.stem, files=(weights, *found.files[1:])))

    def save(self, path: Path, network: nn.Module, card: DetectorCard) -> None:
        """Write the graph with the network's weights; the card comes last.

        Raises:
            RaucaError: onnxruntime computes something else from it than torch does.
        """
        assert isinstance(network, OnnxStudent)
        data = with_tensors(read_graph(self.weights), network.learnt(), HARDENED)
        write_bytes(path, data)
        beside = self.weights.with_suffix(".names")
        if beside.is_file():
            write_bytes(path.with_suffix(".names"), beside.read_bytes())
        _compare(path, network, self.opened(path))
        write_card(path.with_suffix(".json"), card.FORMAT, data, asdict(card))


def onnx_origin(given: str, found: Resolved) -> OnnxOrigin:
    """What can be hardened of ONNX files: graphs of the YOLO family that can be differentiated and know cars.

    Raises:
        RaucaError: another graph; the line says why, and the way around.
    """
    detector = _open(found)
    if not detector.differentiable:
        raise RaucaError(f"{given}: cannot be trained; {detector.obstacle}; {ELSEWHERE}")
    if detector.layout.queries:
        raise RaucaError(
            f"{given}: is {detector.kind}, which says each object once; rauca trains graphs whose overlapping "
            f"predictions are suppressed afterwards, YOLO's and YOLOX's; {ELSEWHERE}"
        )
    class_index(detector, CAR)
    path = found.files[0]
    OnnxStudent(detector, read_graph(path))
    licence = f"that of {path.name}, which it was made from"
    card = DetectorCard(found.name, detector.class_names, detector.size, f"{detector.kind}, ONNX", licence)
    return OnnxOrigin(given, path, file_digest(path), card, ONNX_LR, detector.fingerprint)


def _open(found: Resolved) -> OnnxDetector:
    detector = FAMILIES["onnx"].load(found, None)
    assert isinstance(detector, OnnxDetector)
    return detector


def _values(tensor: TensorProto) -> torch.Tensor:
    return torch.from_numpy(np.array(extra("onnx").numpy_helper.to_array(tensor)))


@torch.no_grad()
def _compare(path: Path, network: OnnxStudent, written: Detector) -> None:
    """Refuse a file whose predictions are not the network's."""
    image = torch.rand(1, 3, 96, 96, generator=torch.Generator().manual_seed(0))
    place = next(network.parameters()).device
    mine, its = network.dense(image.to(place)), written.dense(image)
    for name in ("boxes", "objectness", "classes"):
        off = largest_difference(getattr(mine, name).cpu(), getattr(its, name))
        if not off <= LARGEST_DIFFERENCE:
            raise RaucaError(
                f"{path}: its {name} in onnxruntime are {off:.2g} off what was trained; the weights before this round "
                "are unchanged; please report the graph"
            )
