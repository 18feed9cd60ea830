"""From what the user types to a detector."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import torch

from ..contract import RaucaError
from .darknet import DarknetDetector
from .interface import Detector
from .sources import SOURCES, find_source, read_names
from .store import stored_path, verify


@dataclass(frozen=True)
class Resolved:
    """Everything a detector is built from."""

    name: str
    cfg: Path
    weights: Path
    class_names: tuple[str, ...]


def resolve(name_or_path: str) -> Resolved:
    """Find the files behind a detector's name.

    Args:
        name_or_path: one of three forms. ``"yolov3-tiny"``: a named source, fetched before and verified by sha256.
            ``"yolov3=PATH.weights"``: the named network with weights of your own. ``"PATH.weights"``: the cfg is
            ``PATH.cfg`` and the class names are ``PATH.names``.

    Raises:
        RaucaError: unknown name, missing or damaged file.
    """
    name, equals, path = name_or_path.partition("=")
    if equals:
        source = find_source(name)
        return Resolved(name, source.cfg, _existing(Path(path)), source.class_names)
    if name in SOURCES or not name.endswith(".weights"):
        source = find_source(name)
        verify(source, stored_path(source))
        return Resolved(name, source.cfg, stored_path(source), source.class_names)
    weights = _existing(Path(name))
    cfg, names = weights.with_suffix(".cfg"), weights.with_suffix(".names")
    for beside in (cfg, names):
        if not beside.is_file():
            raise RaucaError(f"{beside}: not found; it must lie beside {weights.name}, or write NETWORK={weights}")
    return Resolved(weights.stem, cfg, weights, read_names(names))


def load_detector(name_or_path: str, size: int = 416, device: torch.device | str = "cpu") -> Detector:
    """Load a detector by name or path, see :func:`resolve`.

    Args:
        size: the network's square input, pixels; a multiple of 32.

    Raises:
        RaucaError: unknown name, missing, damaged or mismatched files, a size the network cannot take.
    """
    found = resolve(name_or_path)
    return DarknetDetector(found.name, found.cfg, found.weights, found.class_names, size).to(device)


def _existing(path: Path) -> Path:
    path = path.expanduser()
    if not path.is_file():
        raise RaucaError(f"{path}: not found")
    return path
