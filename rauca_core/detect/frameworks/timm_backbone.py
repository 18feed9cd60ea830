"""DETR checkpoints whose ResNet was built by timm, read without timm.

The published DETR and Deformable DETR name timm's ResNet as their backbone. It is the network that transformers calls
``ResNetBackbone`` under other tensor names, so the configuration and the names are translated and timm is not needed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torch import Tensor

from ...contract import RaucaError

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


def translated_state(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """The same tensors under transformers' names."""
    return {_translated(name): value for name, value in state.items()}


def _translated(name: str) -> str:
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
