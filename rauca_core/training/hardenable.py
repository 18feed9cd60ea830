"""What can be hardened, and what a hardening of it begins with."""

from __future__ import annotations

from pathlib import Path

from ..contract import RaucaError
from ..contract.files import file_digest
from ..detect.catalogue import SOURCES
from ..detect.classes import class_list
from ..detect.families import FAMILIES
from ..detect.load import load_detector, resolve
from ..detect.synth.card import DetectorCard, read_card
from ..detect.synth.networks import RECIPES, is_darknet
from .framework_origin import FRAMEWORKS, framework_origin
from .onnx_origin import onnx_origin
from .origin import ELSEWHERE, Origin

DARKNET_SIZE, DARKNET_LR = 416, 4e-4


def origin_of(detector: str) -> Origin:
    """What can be hardened: our own detectors, darknet networks, ONNX files, models of the frameworks, and what was
    hardened before.

    Raises:
        RaucaError: another kind of detector, or missing or damaged files.
    """
    source = SOURCES.get(detector.partition("=")[0])
    if source is not None and source.family not in ("synth", "darknet", "onnx", *FRAMEWORKS):
        raise _refusal(detector)  # before its weights are asked for
    found = resolve(detector)
    if found.family == "onnx":
        return onnx_origin(detector, found)
    if found.family in FRAMEWORKS:
        return framework_origin(detector, found)
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


def named_as(detector: str, weights: Path) -> str:
    """Hardened weights as :func:`rauca_core.detect.load_detector` takes them.

    A file may not tell which network it holds: it is told as it was for ``detector``, which was hardened.
    """
    found = resolve(detector)
    return f"{found.network}={weights}" if found.network in FAMILIES[found.family].networks else str(weights)


def _refusal(detector: str) -> RaucaError:
    return RaucaError(
        f"{detector}: rauca hardens its own detectors ({', '.join(RECIPES)}), darknet networks with a name, such as "
        "yolov3-tiny, ONNX files of YOLO and YOLOX, models of torchvision, transformers and MMDetection, and what it "
        f"hardened before; any other: {ELSEWHERE}"
    )
