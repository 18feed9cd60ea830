"""From what the user types to a detector."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..contract.schema import is_plain_name
from ..runtime.devices import find_device
from .callable_detector import CallableDetector
from .catalogue import SOURCES, Source, find_source
from .classes import class_list, read_names
from .exports import refuse_unread
from .families import FAMILIES, Resolved
from .foreign import first_line
from .frameworks.module_detector import is_torchscript
from .frameworks.scaling import read_json
from .interface import Detector
from .renaming import renamed
from .weights import fetch, shipped_path, stored_paths

_FAMILY_OF = {family.suffix: name for name, family in FAMILIES.items() if family.suffix}
_OF_NETWORK = {network: name for name, family in FAMILIES.items() for network in family.networks}


def resolve(name_or_path: str, names: Sequence[str] | None = None) -> Resolved:
    """Find the files behind a detector's name.

    Args:
        name_or_path: one of four forms. ``"yolov3-tiny"``: a named source, downloaded where it is not here yet,
            and verified by sha256.
            ``"yolov3=PATH"``: the named network with weights of your own, a folder for transformers and MMDetection.
            ``"yolox=PATH"``, ``"ultralytics=PATH"``: an ONNX file that does not tell which of the two it is;
            ``"fcos_resnet50_fpn=PATH"``: weights of that model of torchvision, which tell how many classes it has.
            ``"PATH"``: a ``.weights`` (with its ``.cfg``), ``.pb``, ``.caffemodel`` (with its ``.prototxt``), ``.onnx``
            ``.torchscript`` (or ``.pt``, if it is one) or, of a detector of our own, ``.safetensors`` (with its card);
            or a folder of transformers, Optimum or MMDetection. Class names come from a ``.names`` beside it; without
            one, from the files (ONNX, our own, folders) or they are COCO's (``.pb``) or VOC's (``.caffemodel``).
            Another checkpoint of PyTorch (``.pt``) or a file for another runtime is never opened.
        names: of the classes in the network's order, instead of those.

    Raises:
        RaucaError: unknown name, missing or damaged file.
    """
    found = _find(name_or_path, named=names is not None)
    if names is None:
        return found
    if FAMILIES[found.family].named:
        raise RaucaError(
            f"{found.name}: a {found.family} detector's files name its classes; leave names out, or rename by classes"
        )
    return replace(found, class_names=tuple(names))


def _find(name_or_path: str, named: bool) -> Resolved:
    name, equals, path = name_or_path.partition("=")
    if equals and "/" not in name and not Path(name_or_path).is_file():  # a path may hold an equals sign
        if name in _OF_NETWORK:
            return _as_network(name, Path(path).expanduser(), named)
        return _own(find_source(name), Path(path).expanduser())
    mine = Path(name_or_path).expanduser()
    family = "" if name_or_path in SOURCES else _family_of(mine)
    if family == "transformers" and (mine / "model.onnx").is_file() and not (mine / "model.safetensors").is_file():
        return replace(_by_path(mine / "model.onnx", "onnx", named), name=mine.resolve().name)  # Optimum's folder
    if family and FAMILIES[family].folder:
        return Resolved(mine.resolve().name, family, (mine,), None)
    if family:
        return _by_path(_existing(mine), family, named)
    if name_or_path not in SOURCES:
        refuse_unread(mine)
        _refuse_strange(mine)
    source = find_source(name_or_path)
    if source.family == "synth":
        return _of_source(source, (shipped_path(source),))
    if not source.files:
        raise RaucaError(f"{source.name}: its weights must be given as {source.name}=PATH; get them with: {source.how}")
    fetch(source.name)
    return _of_source(source, stored_paths(source))


def _refuse_strange(path: Path) -> None:
    """Raise for what is there and says of no family that it is one of its detectors; else it may be a name."""
    if path.is_dir():
        needed = "transformers' config.json, or MMDetection's configuration and checkpoint"
        raise RaucaError(f"{path}: no kind of folder that is read: it needs {needed}")
    if path.exists():
        suffixes = ", ".join(sorted(_FAMILY_OF))
        raise RaucaError(f"{path}: no kind of file that is read: give {suffixes} or NETWORK={path}")


def _of_source(source: Source, files: tuple[Path, ...]) -> Resolved:
    names = source.class_names if source.categories else None
    files += (source.cfg,) if source.family == "darknet" else ()
    return Resolved(source.name, source.family, files, names, source.network)


def _own(source: Source, path: Path) -> Resolved:
    """A named network with the user's own weights."""
    family = FAMILIES[source.family]
    if source.family == "onnx":
        refuse_unread(path)
    if family.folder:
        if not path.is_dir():
            raise RaucaError(f"{path}: not a folder; {source.name} is loaded from a folder, made by: {source.how}")
        return replace(_of_source(source, (path,)), class_names=None)
    beside = (path.with_suffix(family.beside),) if source.family == "caffe-ssd" else ()
    found = _of_source(source, tuple(map(_existing, (path, *beside))))
    names = path.with_suffix(".names")
    return replace(found, class_names=read_names(names)) if names.is_file() else found


def _as_network(name: str, path: Path, named: bool) -> Resolved:
    """A file that cannot always tell which network it holds."""
    family = _OF_NETWORK[name]
    suffix = FAMILIES[family].suffix
    if suffix:
        refuse_unread(path)
    if suffix and path.suffix != suffix:
        raise RaucaError(f"{path}: a {name} network is read from a {suffix} file")
    return replace(_by_path(_existing(path), family, named), network=name)


def _family_of(path: Path) -> str:
    """The family of a file or folder that says what it is; empty for others."""
    config = path / "config.json"
    if config.is_file() and "model" not in read_json(config):  # that of MMDetection's
        return "transformers"
    if path.is_dir() and any(one.suffix in (".pth", ".safetensors") for one in path.iterdir()):
        return "mmdet"
    if path.suffix in (".pt", ".pth") and is_torchscript(path):  # a checkpoint has these names too
        return "torchscript"
    return _FAMILY_OF.get(path.suffix, "")


def _by_path(weights: Path, name: str, named: bool) -> Resolved:
    family, names = FAMILIES[name], weights.with_suffix(".names")
    beside = [weights.with_suffix(family.beside)] if family.beside else []
    for path in [*beside, *([names] if name == "darknet" and not named else [])]:
        if not path.is_file():
            other = f", or write NETWORK={weights}" if name == "darknet" else ""
            raise RaucaError(f"{path}: not found; it must lie beside {weights.name}{other}")
    usual = class_list(family.classes) if family.classes else None
    return Resolved(weights.stem, name, (weights, *beside), read_names(names) if names.is_file() else usual)


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise RaucaError(f"{path}: not found")
    return path


def load_detector(
    detector: str | Path | nn.Module | Callable[[Tensor], Any],
    size: int | None = None,
    device: torch.device | str = "cpu",
    names: Sequence[str] | None = None,
    classes: Mapping[str, str] | None = None,
    name: str = "",
    fingerprint: str = "",
) -> Detector:
    """Load a detector, ready to be attacked, hardened and evaluated.

    Args:
        detector: a name or path, see :func:`resolve`; or a model in memory, which is copied: torchvision's
            ``FasterRCNN``, ``RetinaNet``, ``FCOS`` or ``SSD``, transformers' DETR, Deformable DETR, RT-DETR or YOLOS;
            any other module, scripted or of torch.export too, see
            :class:`rauca_core.detect.frameworks.module_detector.ModuleDetector`; or any function from images to
            detections, see :class:`rauca_core.detect.callable_detector.CallableDetector`.
        size: the network's square input, pixels; None for the family's own. Graphs of a fixed size refuse others.
        device: that the network lies on, such as ``cuda:1``; images must lie there too.
        names: of the network's classes in its order, without the background; None for those of its files or its list.
            A module and a function hold none: they must be given, and name the background if labels count it.
        classes: from the detector's own class names to those of data sets (COCO's), such as ``{"vehicle.car": "car",
            "vehicle.taxi": "car"}``; see :class:`rauca_core.detect.renaming.RenamedDetector`.
        name: as in tables, instead of the usual one.
        fingerprint: any text that stands for what a function computes; without one no result is kept for later.

    Raises:
        RaucaError: unknown name, missing, damaged or mismatched files, a size the network cannot take, a family whose
            package is not installed, class names of another number, a class that the detector does not have, a device
            that this machine does not have.
    """
    place = find_device(device)
    if name and not is_plain_name(name):
        raise RaucaError(
            f"detector name {name!r}: files bear it; write printable characters without / \\ : or leading dot"
        )
    in_memory = not isinstance(detector, str | Path)
    if fingerprint and (not in_memory or isinstance(detector, nn.Module)):
        raise RaucaError("fingerprint: a network has one by its weights; leave it out for all but functions")
    if isinstance(detector, torch.export.ExportedProgram):
        detector = detector.module()
    if isinstance(detector, nn.Module):
        loaded = _of_module(detector, size, names)
    elif callable(detector):
        loaded = _of_function(detector, size, names, fingerprint)
    else:
        found = resolve(str(detector), names)
        loaded = FAMILIES[found.family].load(found, size)
    loaded.name = name or loaded.name
    return renamed(loaded.to(place), classes)


def _of_module(model: nn.Module, size: int | None, names: Sequence[str] | None) -> Detector:
    """Of a copy: training the model further changes neither the detector nor what its fingerprint stands for."""
    from .frameworks.module_detector import ModuleDetector
    from .frameworks.torchvision_detector import TorchvisionDetector, is_torchvision
    from .frameworks.transformers_detector import TransformersDetector

    name, given = getattr(model, "original_name", type(model).__name__), None if names is None else tuple(names)
    try:
        with torch.no_grad():  # a scripted module's tensors would be computed ones
            copied = copy.deepcopy(model)
    except Exception as error:  # whatever a foreign module holds
        raise RaucaError(f"{name}: cannot be copied ({first_line(error)}); load a function that calls it") from error
    if hasattr(getattr(model, "config", None), "model_type"):
        return TransformersDetector(name, copied, given, size)
    if not given:
        raise RaucaError(f"{name}: a model in memory holds no class names; give names")
    if not is_torchvision(model):
        return ModuleDetector(name, copied, given, size)
    if size is not None:
        raise RaucaError(f"{name}: its input size is its own; leave size out")
    return TorchvisionDetector(name, copied, given)


def _of_function(
    function: Callable[[Tensor], Any], size: int | None, names: Sequence[str] | None, fingerprint: str
) -> Detector:
    made = CallableDetector(function, tuple(names or ()), fingerprint=fingerprint)
    if not made.class_names or size is not None:
        raise RaucaError(f"{made.name}: a callable knows its size but no class names; give names, leave size out")
    return made
