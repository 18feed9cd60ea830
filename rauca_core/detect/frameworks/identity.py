"""What a detector's predictions depend on, as one hexadecimal number."""

from __future__ import annotations

import hashlib

import torch
from torch import nn

# Of a module, but not of what it computes. torchvision's region pooling notes scales and levels of the last call,
# transformers where a model came from.
_PASSING = frozenset({"training", "_has_warned", "scales", "map_levels", "name_or_path", "_use_kernels"})


def fingerprint(model: nn.Module, *settings: object) -> str:
    """sha256 over the model's structure, the plain attributes of all its modules, its tensors, and ``settings``."""
    digest = hashlib.sha256(repr((str(model), settings)).encode())
    for name, module in model.named_modules():
        plain = sorted((key, value) for key, value in vars(module).items() if key not in _PASSING and _is_plain(value))
        digest.update(repr((name, type(module).__qualname__, plain)).encode())
    for name, tensor in sorted(model.state_dict().items()):
        digest.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        digest.update(tensor.detach().cpu().reshape(-1).contiguous().view(torch.uint8).numpy())
    return digest.hexdigest()


def _is_plain(value: object) -> bool:
    if isinstance(value, (list, tuple)):
        return all(_is_plain(one) for one in value)
    if isinstance(value, dict):
        return all(_is_plain(one) for pair in value.items() for one in pair)
    return value is None or isinstance(value, (bool, int, float, str))
