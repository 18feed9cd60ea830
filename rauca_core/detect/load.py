"""From what the user types to a detector."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import nn

from ..contract import RaucaError
from ..runtime.devices import find_device
from .catalogue import SOURCES, Source, find_source
from .classes import class_list, read_names
from .interface import Detector
from .weights import shipped_path, stored_paths, verify

_FAMILY_OF: dict[str, str] = {
    ".weights": "darknet",
    ".pb": "tf-ssd",
    ".caffemodel": "caffe-ssd",
    ".onnx": "onnx",
    ".safetensors": "synth",
}


@dataclass(frozen=True)
class Resolved:
    """Everything a detector is built from.

    Attributes:
        files: the weights first, in the order of the source's files.
        class_names: None when the weights say so themselves, as many ONNX and transformers files do.
        network: see :class:`rauca_core.detect.Source`.
    """

    name: str
    family: str
    files: tuple[Path, ...]
    class_names: tuple[str, ...] | None
    network: str = ""


def resolve(name_or_path: str, classes: Sequence[str] | None = None) -> Resolved:
    """Find the files behind a detector's name.

    Args:
        name_or_path: one of three forms. ``"yolov3-tiny"``: a named source, fetched before and verified by sha256.
            ``"yolov3=PATH"``: the named network with weights of your own, a folder for transformers and MMDetection.
            ``"PATH"``: a ``.weights`` (with its ``.cfg``), ``.pb``, ``.caffemodel`` (with its ``.prototxt``), ``.onnx``
            or, of a detector of our own, ``.safetensors`` (with its card). Class names come from a ``.names`` beside
            it; without one, from the file (ONNX, our own) or they are COCO's (``.pb``) or VOC's (``.caffemodel``).
        classes: names in the network's order instead of those.

    Raises:
        RaucaError: unknown name, missing or damaged file.
    """
    found = _find(name_or_path, named=classes is not None)
    if classes is None:
        return found
    if found.family in ("transformers", "synth"):
        raise RaucaError(f"{found.name}: a {found.family} detector's files name its classes; leave classes out")
    return replace(found, class_names=tuple(classes))


def _find(name_or_path: str, named: bool) -> Resolved:
    name, equals, path = name_or_path.partition("=")
    if equals and "/" not in name and not Path(name_or_path).is_file():  # a path may hold an equals sign
        source = find_source(name)
        return _resolved(source, _own_files(source, Path(path)))
    name = name_or_path
    if name in SOURCES or Path(name).suffix not in _FAMILY_OF:
        source = find_source(name)
        if source.family == "synth":
            return _resolved(source, (shipped_path(source),))
        if not source.files:
            raise RaucaError(f"{name}: its weights must be given as {name}=PATH; get them with: {source.how}")
        verify(source)
        return _resolved(source, stored_paths(source))
    return _by_path(Path(name), named)


def load_detector(
    detector: str | Path | nn.Module,
    size: int | None = None,
    device: torch.device | str = "cpu",
    classes: Sequence[str] | None = None,
) -> Detector:
    """Load a detector, ready to be attacked, hardened and evaluated.

    Args:
        detector: a name or path, see :func:`resolve`; or a model in memory, which is copied: torchvision's
            ``FasterRCNN``, ``RetinaNet``, ``FCOS`` or ``SSD``, transformers' DETR, Deformable DETR or RT-DETR.
        size: the network's square input, pixels; None for the family's own. Graphs of a fixed size refuse others.
        device: that the network lies on, such as ``cuda:1``; images must lie there too.
        classes: names in the network's order, without the background; None for those of its files or its list. A
            model of torchvision holds none: they must be given.

    Raises:
        RaucaError: unknown name, missing, damaged or mismatched files, a size the network cannot take, a family whose
            package is not installed, class names of another number, a device that this machine does not have.
    """
    place = find_device(device)
    if isinstance(detector, nn.Module):
        return _of_module(detector, size, classes).to(place)
    found = resolve(str(detector), classes)
    return _MAKERS[found.family](found, size).to(place)


def _of_module(model: nn.Module, size: int | None, classes: Sequence[str] | None) -> Detector:
    from .frameworks import TorchvisionDetector, TransformersDetector

    name, names = type(model).__name__, None if classes is None else tuple(classes)
    if hasattr(model, "config"):
        return TransformersDetector.of(model, name, names, size)
    if names is None or size is not None:
        raise RaucaError(f"{name}: a model in memory knows its size but no class names; give classes, leave size out")
    return TorchvisionDetector.of(model, name, names)


def _resolved(source: Source, files: tuple[Path, ...]) -> Resolved:
    names = source.class_names if source.categories else None
    return Resolved(source.name, source.family, files, names, source.network)


def _own_files(source: Source, path: Path) -> tuple[Path, ...]:
    """The user's own weights for a named network."""
    path = path.expanduser()
    if source.family in ("transformers", "mmdet"):
        if not path.is_dir():
            raise RaucaError(f"{path}: not a folder; {source.name} is loaded from a folder, made by: {source.how}")
        return (path,)
    return _with_prototxt(path) if source.family == "caffe-ssd" else (_existing(path),)


def _by_path(path: Path, named: bool) -> Resolved:
    weights = _existing(path)
    family = _FAMILY_OF[weights.suffix]
    names = weights.with_suffix(".names")
    if family == "darknet":
        for beside in (weights.with_suffix(".cfg"), *(() if named else (names,))):
            if not beside.is_file():
                raise RaucaError(f"{beside}: not found; it must lie beside {weights.name}, or write NETWORK={weights}")
    usual = {"tf-ssd": "coco-91", "caffe-ssd": "voc-20"}
    class_names = read_names(names) if names.is_file() else class_list(usual[family]) if family in usual else None
    files = _with_prototxt(weights) if family == "caffe-ssd" else (weights,)
    return Resolved(weights.stem, family, files, class_names)


def _with_prototxt(weights: Path) -> tuple[Path, ...]:
    return _existing(weights), _existing(weights.with_suffix(".prototxt"))


def _existing(path: Path) -> Path:
    path = path.expanduser()
    if not path.is_file():
        raise RaucaError(f"{path}: not found")
    return path


# Each adapter is imported when one of its detectors is wanted: frameworks take seconds, and may not be installed.


def _darknet(found: Resolved, size: int | None) -> Detector:
    from .darknet import DarknetDetector

    weights = found.files[0]
    cfg = find_source(found.name).cfg if found.network else weights.with_suffix(".cfg")
    return DarknetDetector(found.name, cfg, weights, _names(found), size)


def _tf_ssd(found: Resolved, size: int | None) -> Detector:
    from .graphs import TfSsdDetector

    return TfSsdDetector(found.name, found.files[0], _names(found), size)


def _caffe_ssd(found: Resolved, size: int | None) -> Detector:
    from .graphs import CaffeSsdDetector

    _refuse_size(found, size)
    return CaffeSsdDetector(found.name, found.files[1], found.files[0], _names(found))


def _onnx(found: Resolved, size: int | None) -> Detector:
    from .onnx_detector import OnnxDetector

    return OnnxDetector(
        found.name, found.files[0], found.class_names, size, "yolox" if found.network == "yolox" else None
    )


def _torchvision(found: Resolved, size: int | None) -> Detector:
    from .frameworks import TorchvisionDetector

    return TorchvisionDetector(found.name, found.network, found.files[0], _names(found), size=size)


def _transformers(found: Resolved, size: int | None) -> Detector:
    from .frameworks import TransformersDetector

    return TransformersDetector(found.name, found.files[0], size=size)


def _mmdet(found: Resolved, size: int | None) -> Detector:
    from .frameworks import MmdetDetector

    _refuse_size(found, size)
    folder = found.files[0]
    config, checkpoint = (_only(folder, pattern) for pattern in ("*.json", "*.pth"))
    return MmdetDetector(found.name, config, checkpoint, found.class_names)


def _synth(found: Resolved, size: int | None) -> Detector:
    from .synth import load_weights

    _refuse_size(found, size)
    return load_weights(found.files[0])


def _names(found: Resolved) -> tuple[str, ...]:
    if found.class_names is None:
        raise RaucaError(
            f"{found.name}: no class names; write them, one per line, into a .names file beside the weights"
        )
    return found.class_names


def _refuse_size(found: Resolved, size: int | None) -> None:
    if size is not None:
        raise RaucaError(f"{found.name}: the input size of a {found.family} detector is its own; leave size out")


def _only(folder: Path, pattern: str) -> Path:
    found = sorted(folder.glob(pattern))
    if len(found) != 1:
        raise RaucaError(f"{folder}: must hold exactly one {pattern}, found {len(found)}")
    return found[0]


_MAKERS: dict[str, Callable[[Resolved, int | None], Detector]] = {
    "darknet": _darknet,
    "tf-ssd": _tf_ssd,
    "caffe-ssd": _caffe_ssd,
    "onnx": _onnx,
    "torchvision": _torchvision,
    "transformers": _transformers,
    "mmdet": _mmdet,
    "synth": _synth,
}
