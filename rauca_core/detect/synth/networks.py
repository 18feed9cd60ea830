"""Our detectors by name: what each is, and how its network is built."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch
from torch import nn

from ...contract import RaucaError
from ...contract.assets import assets_folder
from ...contract.seeding import named_seed
from ..catalogue import SOURCES
from .network import DarknetBackbone

BACKBONE = "yolov4-tiny"


@dataclass(frozen=True)
class Recipe:
    """A detector of our own.

    Attributes:
        architecture: for people.
        lr: AdamW's learning rate that suits it.
    """

    architecture: str
    lr: float


RECIPES = {
    "frcnn-synth": Recipe("Faster R-CNN (torchvision) with a feature pyramid, on the backbone of YOLOv4-tiny", 5e-4),
    "detr-synth": Recipe("RT-DETR (transformers) with three decoder layers, on the backbone of YOLOv4-tiny", 4e-4),
}


def find_recipe(name: str) -> Recipe:
    """The recipe of that name; an unknown name lists what there is."""
    if name not in RECIPES:
        raise RaucaError(f"{name}: not a detector that rauca trains; choose one of {', '.join(RECIPES)}")
    return RECIPES[name]


def build_network(name: str, classes: int, backbone: Path | None = None, seed: int = 0) -> nn.Module:
    """A network with drawn weights, its backbone's read from darknet weights unless that is None.

    Raises:
        RaucaError: unknown name; the packages of ``rauca[detectors]`` are missing, which our own need; unusable
            weights.
    """
    if is_darknet(name):
        from .darknet_student import DarknetStudent

        return DarknetStudent(SOURCES[name].cfg)
    find_recipe(name)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(named_seed(seed, "weights", name))
        start = DarknetBackbone(assets_folder() / "detectors" / f"{BACKBONE}.cfg", backbone)
        if name == "frcnn-synth":
            from .two_stage import TwoStage

            return TwoStage(start, classes)
        from .transformer import Transformer

        return Transformer(start, classes)


def is_darknet(name: str) -> bool:
    """Whether that is a darknet network of the catalogue, which can be hardened, not trained from nothing."""
    return name in SOURCES and SOURCES[name].family == "darknet"
