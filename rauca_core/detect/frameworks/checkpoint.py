"""Published weights into a framework's module, whole or refused, and what its predictions then depend on."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Iterable, Mapping
from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from ...contract import RaucaError
from ...contract.reading import require_file
from ..foreign import first_line

# Where training scripts put the weights inside a checkpoint.
_WRAPPERS = ("model", "state_dict", "model_state_dict")
_ANEW = "save it anew as torch.save(model.state_dict(), PATH) or as .safetensors"


def read_state(path: Path) -> Mapping[str, Tensor]:
    """The tensors of a ``.safetensors`` file or of a torch checkpoint, by name, on the CPU.

    Raises:
        RaucaError: as of :func:`read_checkpoint` and :func:`tensors_of`.
    """
    return tensors_of(read_checkpoint(path), path)


def read_checkpoint(path: Path, anew: str = _ANEW) -> object:
    """What a ``.safetensors`` file or a torch checkpoint holds, on the CPU.

    A torch checkpoint is read with ``weights_only=True``: tensors and plain containers, no other pickled object.

    Args:
        anew: what mends a checkpoint that holds other objects.

    Raises:
        RaucaError: missing or damaged file, a checkpoint that holds other objects.
    """
    require_file(path)
    try:
        if path.suffix == ".safetensors":
            return load_file(path)
        held: object = torch.load(path, map_location="cpu", weights_only=True)
        return held
    except pickle.UnpicklingError:
        raise RaucaError(f"{path}: holds objects other than tensors, which could run code; {anew}") from None
    except Exception as error:  # torch's readers raise whatever a damaged file makes of them
        raise RaucaError(f"{path}: cannot be read as weights ({first_line(error)})") from error


def tensors_of(state: object, path: Path) -> Mapping[str, Tensor]:
    """The tensors by name in what ``path`` held.

    Raises:
        RaucaError: none, or values that are not finite.
    """
    for wrapper in _WRAPPERS:
        if isinstance(state, Mapping) and isinstance(state.get(wrapper), Mapping):
            state = state[wrapper]
    if not isinstance(state, Mapping) or not state or not all(isinstance(one, Tensor) for one in state.values()):
        raise RaucaError(f"{path}: holds no tensors by name; expected the state_dict of a model")
    for name, one in state.items():
        if one.layout != torch.strided or one.untyped_storage().nbytes() < one.numel() * one.element_size():
            raise RaucaError(f"{path}: tensor {str(name)[:80]} is larger than what the file holds of it; damaged")
        if one.is_floating_point() and not torch.isfinite(one).all():
            raise RaucaError(f"{path}: tensor {name} holds values that are not finite; the file is damaged")
    return state


def fill(module: nn.Module, state: Mapping[str, Tensor], path: Path) -> None:
    """Copy every tensor of ``state`` into ``module``.

    Raises:
        RaucaError: names ``path`` and the first tensor that is missing, unknown or of another shape.
    """
    kind = type(module).__name__
    try:
        unmatched = module.load_state_dict(state, strict=False)
    except RuntimeError as error:
        wrong = next((line.strip() for line in str(error).splitlines() if "size mismatch" in line), first_line(error))
        raise RaucaError(
            f"{path}: does not fit {kind}: {wrong.rstrip('.')}; these are another model's weights"
        ) from None
    require_none(path, kind, {"lacks": unmatched.missing_keys, "has an unknown": unmatched.unexpected_keys})


def require_none(path: Path, kind: str, wrong: Mapping[str, Iterable[str]]) -> None:
    """Refuse weights of a ``kind`` of model, of which tensors are wrong in one of these ways.

    The training steps that batch normalizations count do not matter; files and modules may have them or not.
    """
    for fault, names in wrong.items():
        told = sorted(name for name in names if not name.endswith("num_batches_tracked"))
        if told:
            more = f" and {len(told) - 1} more" if len(told) > 1 else ""
            raise RaucaError(f"{path}: {fault} tensor {told[0]}{more}; expected the weights of a {kind}")


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
