"""MMDetection's configurations, as data.

A configuration of MMDetection is a Python file, so reading one runs it. Here only its JSON dump is read, and only what
describes the network. Types in it are names that MMDetection's registry knows: a dotted name would make the registry
import and call whatever it points to, and is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from ...contract import RaucaError
from .scaling import read_json

DUMP = "python -c \"from mmengine import Config; Config.fromfile('CONFIG.py').dump('CONFIG.json')\""

_KNOWN_STEPS = frozenset({"LoadImageFromFile", "Resize", "LoadAnnotations", "PackDetInputs"})


@dataclass(frozen=True)
class Preparation:
    """What the test pipeline and the data preprocessor do to an image.

    Attributes:
        scale: (longer, shorter) side that bounds the scaled image, or its (width, height) where the aspect is not kept.
        keep_ratio: whether the aspect is kept.
        mean, std: of the channels in the network's order, for values in 0..255.
        rgb: whether the network's order is red, green, blue; else it is reversed.
        divisor: height and width are filled up to a multiple of this, at the right and at the bottom.
        fill: the value there, after normalization.
    """

    scale: tuple[int, int]
    keep_ratio: bool
    mean: tuple[float, ...]
    std: tuple[float, ...]
    rgb: bool
    divisor: int
    fill: float

    def fit(self, name: str, images: Tensor) -> tuple[Tensor, tuple[int, int]]:
        """(B, 3, H, W) sRGB in [0, 1] to the network's input, contiguous, and the size of the image in it.

        Images come with their channels last in memory, where mmcv's RoIAlign on a CPU takes them for contiguous: what
        it pooled would be wrong without a word.
        """
        height, width = self.size_of(images.shape[2], images.shape[3])
        if min(height, width) < 1:
            raise RaucaError(f"{name}: images of {images.shape[3]} x {images.shape[2]} pixels are too narrow")
        images = functional.interpolate(images, (height, width), mode="bilinear", align_corners=False)
        images = 255 * (images if self.rgb else images.flip(1))
        mean, std = (torch.tensor(one, device=images.device, dtype=images.dtype) for one in (self.mean, self.std))
        images = (images - mean[:, None, None]) / std[:, None, None]
        right, bottom = -width % self.divisor, -height % self.divisor
        return functional.pad(images, (0, right, 0, bottom), value=self.fill).contiguous(), (height, width)

    def size_of(self, height: int, width: int) -> tuple[int, int]:
        """(height, width) that an image is scaled to, rounded as MMDetection rounds."""
        if not self.keep_ratio:
            return self.scale[1], self.scale[0]
        factor = min(max(self.scale) / max(height, width), min(self.scale) / min(height, width))
        return int(height * factor + 0.5), int(width * factor + 0.5)


def read_config(path: Path) -> tuple[dict[str, Any], Preparation]:
    """The network's description and the preparation of its images.

    Raises:
        RaucaError: not a JSON dump, types that are not plain names, preparation that is not known here.
    """
    if path.suffix != ".json":
        raise RaucaError(f"{path}: a configuration in Python would be run; dump it as JSON where you trust it: {DUMP}")
    config = read_json(path)
    model = config.get("model")
    if not isinstance(model, dict) or not isinstance(model.get("data_preprocessor"), dict):
        raise RaucaError(f"{path}: describes no model of MMDetection 3; make it with: {DUMP}")
    _check_types(path, model)
    try:
        return _without_pretraining(model), _preparation(path, config, model["data_preprocessor"])
    except (KeyError, TypeError, ValueError, IndexError, StopIteration, OverflowError, AttributeError) as error:
        raise RaucaError(f"{path}: its test pipeline or data_preprocessor is not understood ({error!r})") from error


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


def _preparation(path: Path, config: dict[str, Any], preprocessor: dict[str, Any]) -> Preparation:
    if preprocessor["type"] != "DetDataPreprocessor":
        raise RaucaError(f"{path}: data_preprocessor {preprocessor['type']} is not supported")
    steps = config["test_dataloader"]["dataset"]["pipeline"]
    unknown = [step["type"] for step in steps if step["type"] not in _KNOWN_STEPS]
    if unknown:
        raise RaucaError(f"{path}: step {unknown[0]} of its test pipeline is not supported")
    resize = next(step for step in steps if step["type"] == "Resize")
    mean, std = (tuple(map(float, preprocessor[key])) for key in ("mean", "std"))
    longer, shorter = (int(one) for one in resize["scale"])
    return Preparation(
        scale=(longer, shorter),
        keep_ratio=bool(resize.get("keep_ratio", False)),
        mean=mean,
        std=std,
        rgb=bool(preprocessor.get("bgr_to_rgb", False)),
        divisor=int(preprocessor.get("pad_size_divisor", 1)),
        fill=float(preprocessor.get("pad_value", 0)),
    )
