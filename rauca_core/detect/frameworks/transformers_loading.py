"""transformers' detection models from a local folder: no network, no code from the folder, no pickle.

The published DETR and Deformable DETR name timm's ResNet as their backbone. It is the network that transformers calls
``ResNetBackbone`` under other tensor names, so the configuration and the names are translated and timm is not needed.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ...contract import RaucaError
from ..foreign import extra
from .checkpoint import read_state, require_none
from .scaling import AS_THEY_ARE, Scaling, read_json
from .torchvision_ops import import_torchvision

_DEPTHS = {
    "resnet18": (2, 2, 2, 2),
    "resnet34": (3, 4, 6, 3),
    "resnet50": (3, 4, 6, 3),
    "resnet101": (3, 4, 23, 3),
    "resnet152": (3, 8, 36, 3),
}
_TIMM = re.compile(r"^(.*backbone\.(?:conv_encoder\.)?model\.)((?:conv1|bn1|layer\d)\b.*)$")
_PART = {"conv": "convolution", "bn": "normalization"}


def uses_timm(config: Mapping[str, Any]) -> bool:
    """Whether a DETR's ``config.json`` asks for timm; older files do so by default."""
    backbone = config.get("backbone_config")
    if isinstance(backbone, Mapping):
        return backbone.get("model_type") == "timm_backbone"
    return bool(config.get("use_timm_backbone", True))


def translated_config(config: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """The same ``config.json`` with transformers' ResNet.

    Raises:
        RaucaError: a backbone that is no plain ResNet, or a dilated one.
    """
    inner = config.get("backbone_config") or {}
    if not isinstance(inner, dict):
        raise RaucaError(f"{path}: backbone_config is no JSON object")
    name = config.get("backbone") or inner.get("backbone") or "resnet50"
    plain = str(name).partition(".")[0]
    if plain not in _DEPTHS or config.get("dilation"):
        kind = "a dilated backbone" if config.get("dilation") else f"backbone {name!r}"
        raise RaucaError(f"{path}: {kind} is not supported; known are {', '.join(_DEPTHS)}")
    basic = plain in ("resnet18", "resnet34")
    first = 2 if config["model_type"] == "deformable_detr" and config.get("num_feature_levels", 4) > 1 else 4
    resnet = {
        "model_type": "resnet",
        "depths": list(_DEPTHS[plain]),
        "layer_type": "basic" if basic else "bottleneck",
        "hidden_sizes": [64, 128, 256, 512] if basic else [256, 512, 1024, 2048],
        "out_features": [f"stage{stage}" for stage in range(first, 5)],
    }
    dropped = ("backbone", "backbone_kwargs", "use_pretrained_backbone", "backbone_config", "use_timm_backbone")
    kept = {key: value for key, value in config.items() if key not in dropped}
    return kept | {"use_timm_backbone": False, "backbone_config": resnet}


def translated_name(name: str) -> str:
    """A tensor's name in transformers."""
    found = _TIMM.match(name)
    if not found:
        return name
    prefix, rest = found.groups()
    stem = re.match(r"(conv|bn)1\.(\w+)$", rest)
    if stem:
        return f"{prefix}embedder.embedder.{_PART[stem[1]]}.{stem[2]}"
    block = re.match(r"layer(\d)\.(\d+)\.(?:(conv|bn)(\d)|downsample\.([01]))\.(\w+)$", rest)
    if not block:
        return name
    stage, layer, part, number, shortcut, tensor = block.groups()
    place = f"{prefix}encoder.stages.{int(stage) - 1}.layers.{layer}"
    if shortcut is not None:
        return f"{place}.shortcut.{_PART['bn' if int(shortcut) else 'conv']}.{tensor}"
    return f"{place}.layer.{int(number) - 1}.{_PART[part]}.{tensor}"


MAX_LAYERS = 256
MAX_NUMBER = 2**16  # of any size in a configuration; the largest in use, of feed-forward layers, is 2048


@dataclass(frozen=True)
class Family:
    """What sets one architecture's predictions apart.

    Attributes:
        prefix: of transformers' classes.
        softmax: categories share one probability with "no object", the last column; else each has its own sigmoid.
        limit: most detections of an image; 0 for one per query.
        scaling: of the published models.
        may_use_timm: the published models name timm's ResNet as their backbone.
    """

    prefix: str
    softmax: bool
    limit: int
    scaling: Scaling
    may_use_timm: bool = False


_SQUARE = Scaling(0, 0, 640, 640, *AS_THEY_ARE)
FAMILIES = {
    "detr": Family("Detr", True, 0, Scaling(), may_use_timm=True),
    "deformable_detr": Family("DeformableDetr", False, 100, Scaling(), may_use_timm=True),
    "rt_detr": Family("RTDetr", False, 0, _SQUARE),
    "rt_detr_v2": Family("RTDetrV2", False, 0, _SQUARE),
    "yolos": Family("Yolos", True, 0, Scaling(multiple=16)),
}


def import_transformers() -> Any:
    """The transformers package, told to stay off the network.

    Raises:
        RaucaError: it is not installed.
    """
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    with contextlib.suppress(RaucaError):
        import_torchvision()  # transformers imports it where it is installed
    return extra("transformers")


def family_of(name: str, model_type: object) -> Family:
    """The family of a configuration's ``model_type``; raises :class:`RaucaError` for others."""
    if not isinstance(model_type, str) or model_type not in FAMILIES:
        raise RaucaError(f"{name}: model type {model_type!r} is not supported; known are {', '.join(FAMILIES)}")
    return FAMILIES[model_type]


def load_model(folder: Path) -> Any:
    """The model of ``config.json`` with the weights of ``model.safetensors``.

    Raises:
        RaucaError: missing or unreadable files, an unknown architecture, weights that do not fit it; one line that
            names the file and the first wrong tensor.
    """
    path, weights = folder / "config.json", folder / "model.safetensors"
    config = read_json(path)
    family = family_of(str(path), config.get("model_type"))
    transformers = import_transformers()
    if not weights.is_file():
        raise RaucaError(f"{weights}: not found; only weights as .safetensors are read")
    state = read_state(weights)
    if family.may_use_timm and uses_timm(config):
        config, state = translated_config(config, path), {translated_name(name): value for name, value in state.items()}
    _refuse_giants(path, config)
    config |= {"use_pretrained_backbone": False}  # weights of another file, wherever its name points
    # Sizes that tables of positions would be made for beforehand; images may have any.
    config |= {key: None for key in ("anchor_image_size", "eval_size") if key in config}
    try:
        described = getattr(transformers, f"{family.prefix}Config").from_dict(config)
        return _filled(getattr(transformers, f"{family.prefix}ForObjectDetection"), described, state, weights)
    except RaucaError:
        raise
    except Exception as error:  # each version of transformers has its own errors for a wrong configuration
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise RaucaError(f"{path}: transformers cannot build this model ({reason})") from error


def _refuse_giants(path: Path, value: Any, key: str = "") -> None:
    """Layers are made one by one before any weight is compared."""
    if isinstance(value, dict):
        for name, inner in value.items():
            _refuse_giants(path, inner, name)
    elif isinstance(value, list):
        for inner in value:
            _refuse_giants(path, inner, key)
    elif isinstance(value, int | float):
        most = MAX_LAYERS if "layers" in key or key == "depths" else MAX_NUMBER
        if not abs(value) <= most:
            raise RaucaError(f"{path}: {key} is {str(value)[:20]}; at most {most} is read")


def _filled(kind: Any, config: Any, state: Mapping[str, Tensor], path: Path) -> Any:
    """Through transformers' loader, which knows the names that tensors had in its earlier versions."""
    held = sum(value.numel() for value in state.values())
    with quiet():
        with torch.device("meta"):
            wanted = sum(parameter.numel() for parameter in kind(config).parameters())
        if wanted > 2 * held:  # a file that lacks a tensor or two is told which
            raise RaucaError(
                f"{path}: holds {held} numbers for a network of {wanted}; these are another model's weights"
            )
        model, report = kind.from_pretrained(
            None, config=config, state_dict=dict(state), output_loading_info=True, ignore_mismatched_sizes=True
        )
    wrong = {
        "has another shape of": [str(name) for name, *_ in report["mismatched_keys"]],
        "lacks": report["missing_keys"],
        "has an unknown": report["unexpected_keys"],
    }
    require_none(path, kind.__name__, wrong)
    return model.float()


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """transformers' tables of wrong tensors and progress bars go to the terminal; errors here say what is wrong."""
    log = import_transformers().utils.logging
    level, bars = log.get_verbosity(), log.is_progress_bar_enabled()
    log.set_verbosity(log.CRITICAL)
    log.disable_progress_bar()
    try:
        yield
    finally:
        log.set_verbosity(level)
        if bars:
            log.enable_progress_bar()
