"""MMDetection's configurations, read without running them.

A configuration of MMDetection is a Python file that inherits from others. Read here is what it comes to: the file
without inheritance that MMDetection writes beside the checkpoints of a training, or a JSON dump of it. Of either only
plain values count, and only those that describe the network and its images. Types in it are names that MMDetection's
registry knows: a dotted name would make the registry import and call whatever it points to, and is refused.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from ...contract import RaucaError
from ...contract.reading import read_text
from .scaling import AS_THEY_ARE, MAX_CONFIG_BYTES, normalized, read_json

DUMP = "python -c \"from mmengine import Config; Config.fromfile('CONFIG.py').dump('CONFIG.json')\""

_KNOWN_STEPS = frozenset({"LoadImageFromFile", "Resize", "Pad", "LoadAnnotations", "PackDetInputs"})
_READ = frozenset({"model", "test_dataloader"})


@dataclass(frozen=True)
class Frame:
    """What the pipeline's step ``Pad`` makes of a scaled image, before it is normalized.

    Attributes:
        width, height: pixels that are filled up to; 0 where nothing is.
        square: filled up to a square instead.
        divisor: sides are filled up to a multiple of this.
        value: of the channels in the order blue, green, red, in 0..255.
    """

    width: int = 0
    height: int = 0
    square: bool = False
    divisor: int = 1
    value: tuple[float, ...] = (0.0, 0.0, 0.0)

    def size_of(self, height: int, width: int) -> tuple[int, int]:
        """(height, width) after filling up; at the right and at the bottom, and never less."""
        if self.square:
            height = width = max(height, width)
        height, width = max(height, self.height), max(width, self.width)
        return height + -height % self.divisor, width + -width % self.divisor


@dataclass(frozen=True)
class Prepared:
    """A batch as the network takes it.

    Attributes:
        batch: (B, 3, H, W), contiguous.
        size: (height, width) of the image in it.
        framed: (height, width) with what ``Pad`` added: the image to MMDetection.
    """

    batch: Tensor
    size: tuple[int, int]
    framed: tuple[int, int]


@dataclass(frozen=True)
class Preparation:
    """What the test pipeline and the data preprocessor do to an image.

    Attributes:
        scale: (longer, shorter) side that bounds the scaled image, or its (width, height) where the aspect is not kept.
        keep_ratio: whether the aspect is kept.
        frame: filled up before normalization.
        mean, std: of the channels in the network's order, for values in 0..255.
        rgb: whether the network's order is red, green, blue; else it is reversed.
        divisor: height and width are filled up to a multiple of this, at the right and at the bottom.
        fill: the value there, after normalization.
    """

    scale: tuple[int, int]
    keep_ratio: bool
    frame: Frame
    mean: tuple[float, ...]
    std: tuple[float, ...]
    rgb: bool
    divisor: int
    fill: float

    def fit(self, name: str, images: Tensor) -> Prepared:
        """Images (B, 3, H, W), sRGB in [0, 1], to the network's input.

        Images come with their channels last in memory, where mmcv's RoIAlign on a CPU takes them for contiguous: what
        it pooled would be wrong without a word.

        Raises:
            RaucaError: names the detector ``name``: images so narrow that nothing would be left of them.
        """
        size = self.size_of(images.shape[2], images.shape[3])
        if min(size) < 1:
            raise RaucaError(f"{name}: images of {images.shape[3]} x {images.shape[2]} pixels are too narrow")
        images = 255 * functional.interpolate(images, size, mode="bilinear", align_corners=False)
        framed = self.frame.size_of(*size)
        images = _filled_up(images.flip(1), framed, self.frame.value)
        images = normalized(images.flip(1) if self.rgb else images, self.mean, self.std)
        height, width = (side + -side % self.divisor for side in framed)
        return Prepared(_filled_up(images, (height, width), [self.fill] * 3).contiguous(), size, framed)

    def size_of(self, height: int, width: int) -> tuple[int, int]:
        """(height, width) that an image is scaled to, rounded as MMDetection rounds."""
        if not self.keep_ratio:
            return self.scale[1], self.scale[0]
        factor = min(max(self.scale) / max(height, width), min(self.scale) / min(height, width))
        return int(height * factor + 0.5), int(width * factor + 0.5)


def _filled_up(images: Tensor, size: tuple[int, int], values: tuple[float, ...] | list[float]) -> Tensor:
    below, right = size[0] - images.shape[2], size[1] - images.shape[3]
    if below == 0 and right == 0:
        return images
    if len(set(values)) == 1:
        return functional.pad(images, (0, right, 0, below), value=values[0])
    over = [functional.pad(images[:, i : i + 1], (0, right, 0, below), value=one) for i, one in enumerate(values)]
    return torch.cat(over, 1)


@dataclass(frozen=True)
class Described:
    """What a configuration says.

    Attributes:
        model: for MMDetection's registry.
        preparation: of its images.
        class_names: of its test data; empty where it leaves them out.
    """

    model: dict[str, Any]
    preparation: Preparation
    class_names: tuple[str, ...]


def read_config(path: Path) -> Described:
    """The network's description, the preparation of its images and the names of its classes.

    Args:
        path: ``.json``, made by :data:`DUMP`, or a ``.py`` of nothing but plain values.

    Raises:
        RaucaError: another file, types that are not plain names, preparation that is not known here.
    """
    config = read_json(path) if path.suffix == ".json" else _read_python(path)
    model = config.get("model")
    if not isinstance(model, dict) or not isinstance(model.get("data_preprocessor"), dict):
        raise RaucaError(f"{path}: describes no model of MMDetection 3; make it with: {DUMP}")
    _check_types(path, model)
    try:
        data = config["test_dataloader"]["dataset"]
        preparation = _preparation(path, data["pipeline"], model["data_preprocessor"])
        return Described(_without_pretraining(model), preparation, names_of(data.get("metainfo")))
    except (KeyError, TypeError, ValueError, IndexError, StopIteration, OverflowError, AttributeError) as error:
        raise RaucaError(f"{path}: its test pipeline or data_preprocessor is not understood ({error!r})") from error


def names_of(described: object) -> tuple[str, ...]:
    """The class names in a data set's ``metainfo``; none where it holds no list of words."""
    found = described.get("classes", described.get("CLASSES")) if isinstance(described, dict) else None
    names = tuple(found) if isinstance(found, (list, tuple)) else ()
    return names if all(isinstance(one, str) and one.strip() for one in names) else ()


def _read_python(path: Path) -> dict[str, Any]:
    """The plain values of a configuration without inheritance; nothing of it is run."""
    text = read_text(path, MAX_CONFIG_BYTES, "a configuration")
    try:
        assigned = [_assignment(statement) for statement in ast.parse(text).body]
        return {name: _plain(value) for name, value in assigned if name in _READ}
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise RaucaError(
            f"{path}: would have to be run ({error or type(error).__name__}); take the one that MMDetection wrote "
            f"beside the checkpoint, or a dump of it, made where you trust it: {DUMP}"
        ) from None


def _assignment(statement: ast.stmt) -> tuple[str, ast.expr]:
    match statement:
        case ast.Assign(targets=[ast.Name(id=name)], value=value) if name != "_base_":
            return name, value
    raise ValueError(f"line {statement.lineno} is more than a plain value")


def _plain(node: ast.expr) -> Any:
    match node:
        case ast.Constant(value=str() | bool() | int() | float() | None as value):
            return value
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return -value
        case ast.List(elts=parts) | ast.Tuple(elts=parts):
            return [_plain(part) for part in parts]
        case ast.Dict(keys=keys, values=values) if all(isinstance(key, ast.Constant) for key in keys):
            return {_plain(key): _plain(value) for key, value in zip(keys, values, strict=True) if key is not None}
        case ast.Call(func=ast.Name(id="dict"), args=[], keywords=words) if all(word.arg for word in words):
            return {word.arg: _plain(word.value) for word in words}
    raise ValueError(f"line {node.lineno} is more than a plain value")


def _check_types(path: Path, value: Any) -> None:
    if isinstance(value, dict):
        kind = value.get("type", "plain")
        if not isinstance(kind, str) or not kind.isidentifier():
            raise RaucaError(f"{path}: type {kind!r} is not the name of a registered module; dotted names are refused")
        value = list(value.values())
    if isinstance(value, list):
        for one in value:
            _check_types(path, one)


def _without_pretraining(value: Any) -> Any:
    """``init_cfg`` names weights that would be downloaded, to be overwritten by the checkpoint's."""
    if isinstance(value, dict):
        return {key: _without_pretraining(one) for key, one in value.items() if key not in ("init_cfg", "pretrained")}
    return [_without_pretraining(one) for one in value] if isinstance(value, list) else value


def _preparation(path: Path, steps: list[dict[str, Any]], preprocessor: dict[str, Any]) -> Preparation:
    if preprocessor["type"] != "DetDataPreprocessor":
        raise RaucaError(f"{path}: data_preprocessor {preprocessor['type']} is not supported")
    unknown = [step["type"] for step in steps if step["type"] not in _KNOWN_STEPS]
    if unknown:
        raise RaucaError(f"{path}: step {unknown[0]} of its test pipeline is not supported")
    kinds = [step["type"] for step in steps if step["type"] in ("Resize", "Pad")]
    if kinds not in (["Resize"], ["Resize", "Pad"]):
        raise RaucaError(f"{path}: its test pipeline must resize once and then pad at most once, found {kinds}")
    resize = next(step for step in steps if step["type"] == "Resize")
    pad = next((step for step in steps if step["type"] == "Pad"), {})
    usual = dict(zip(("mean", "std"), AS_THEY_ARE, strict=True))
    mean, std = (_of_channels(preprocessor.get(key) or usual[key]) for key in ("mean", "std"))
    longer, shorter = (int(one) for one in resize["scale"])
    return Preparation(
        scale=(longer, shorter),
        keep_ratio=bool(resize.get("keep_ratio", False)),
        frame=_frame(pad),
        mean=mean,
        std=std,
        rgb=bool(preprocessor.get("bgr_to_rgb") or preprocessor.get("rgb_to_bgr")),  # either reverses the channels
        divisor=int(preprocessor.get("pad_size_divisor", 1)),
        fill=float(preprocessor.get("pad_value", 0)),
    )


def _frame(step: dict[str, Any]) -> Frame:
    value = step.get("pad_val", 0)
    value = value.get("img", 0) if isinstance(value, dict) else value
    if step.get("padding_mode", "constant") != "constant":
        raise ValueError("Pad repeats pixels")
    width, height = step.get("size") or (0, 0)
    divisor = step.get("size_divisor") or 1
    square = bool(step.get("pad_to_square", False))
    return Frame(int(width), int(height), square, int(divisor), _of_channels(value))


def _of_channels(value: Any) -> tuple[float, ...]:
    values = tuple(map(float, value if isinstance(value, (list, tuple)) else [value] * 3))
    if len(values) != 3:
        raise ValueError(f"{len(values)} channels")
    return values
