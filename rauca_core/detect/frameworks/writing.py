"""A framework's model with other weights, written as it was read: what rauca and the framework itself load again."""

from __future__ import annotations

import io
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import safetensors.torch
import torch
from torch import Tensor

from ...contract.files import atomic_folder, write_bytes
from .checkpoint import read_checkpoint
from .transformers_loading import load_model, quiet

Tensors = Mapping[str, Tensor]


def write_torchvision(source: Path, target: Path, state: Tensors, names: Sequence[str]) -> Path:
    """A state dict, ``.safetensors`` or of ``torch.save``, with the names of its classes beside it.

    Args:
        source: the file that was read.
        target: the file that is written.
        state: all of the model's.

    Returns:
        The file that holds the tensors.
    """
    write_bytes(target, _bytes_of(target, state, {}))
    write_bytes(target.with_suffix(".names"), "".join(f"{name}\n" for name in names).encode())
    return target


def write_transformers(source: Path, target: Path, state: Tensors, names: Sequence[str]) -> Path:
    """A folder by transformers' own writer; how images are prepared is copied. timm's backbone is transformers' then.

    Args:
        state: of the parameters that changed alone: the model that it came from has had its normalization folded.
    """
    model = load_model(source)
    own = dict(model.named_parameters())
    with torch.no_grad():
        for name, value in state.items():
            if name in own:
                own[name].copy_(value)
    with atomic_folder(target) as folder, quiet():
        model.save_pretrained(folder)
        _copy(source, folder, lambda path: path.name == "preprocessor_config.json")
    return target / "model.safetensors"


def write_mmdet(source: Path, target: Path, state: Tensors, names: Sequence[str]) -> Path:
    """A folder of configuration, checkpoint and, if there is one, the ``.names``; an optimizer's state is left out."""
    checkpoint = next(path for path in sorted(source.iterdir()) if path.suffix in (".pth", ".safetensors"))
    held = read_checkpoint(checkpoint)
    meta = {"meta": held["meta"]} if isinstance(held, Mapping) and "meta" in held else {}
    with atomic_folder(target) as folder:
        _copy(source, folder, lambda path: path.suffix in (".py", ".json", ".names"))
        (folder / checkpoint.name).write_bytes(_bytes_of(checkpoint, state, meta))
    return target / checkpoint.name


def _copy(source: Path, target: Path, wanted: Callable[[Path], bool]) -> None:
    for path in sorted(source.iterdir()):
        if path.is_file() and wanted(path):
            shutil.copyfile(path, target / path.name)


def _bytes_of(path: Path, state: Tensors, meta: Mapping[str, object]) -> bytes:
    """What ``path`` shall hold; with ``meta`` the state is an entry beside it, as in MMDetection's checkpoints."""
    tensors = {name: value.detach().cpu().clone().contiguous() for name, value in state.items()}
    if path.suffix == ".safetensors":
        return safetensors.torch.save(tensors)
    stream = io.BytesIO()
    torch.save({**meta, "state_dict": tensors} if meta else tensors, stream)
    return stream.getvalue()
