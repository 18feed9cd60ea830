"""Readers of checkpoints, of our own extractor's weights, and of cached taps."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import torch

from rauca_core.environment.extractor import LightSplitter, PublishedEfe
from rauca_core.environment.weights import ModelCard, PublishedCard, load_extractor, load_published, save_extractor
from rauca_core.render.sparse import SparseOperator
from rauca_core.render.taps import Taps
from rauca_core.runtime.tensor_files import Checkpoint, load_checkpoint, require_same, save_checkpoint
from rauca_core.training.loop import AveragedCopy, Task

from .mutate import mutate_json
from .target import Target

STEP = "step-00000003.safetensors"


def _checkpoint(folder: Path) -> None:
    names = ("parameter", "exp_avg", "exp_avg_sq", "adam_step", "order", "next")
    save_checkpoint(folder, Checkpoint(3, {"seed": 1}, {name: torch.ones(2) for name in names}))


class _Trained(Task):
    """The smallest thing that learns."""

    batch = loss = names = test = to_json = lambda *_: None  # never asked

    def __init__(self) -> None:
        self.network = torch.nn.Linear(2, 1)
        self.optimizer = torch.optim.AdamW(self.network.parameters())
        self.average = AveragedCopy(self.network, 0.9)


def _training(folder: Path) -> None:
    save_checkpoint(folder, Checkpoint(3, {"seed": 1}, _Trained().tensors()))


def _restored(folder: Path) -> None:
    found = load_checkpoint(folder)
    require_same(folder, "training", found.identity, {"seed": 1})
    _Trained().restore(found.tensors)


def _extractor(folder: Path) -> None:
    torch.manual_seed(0)
    save_extractor(folder / "w.safetensors", LightSplitter((4, 4), 4), ModelCard((4, 4), detail=4))


def _published(folder: Path) -> None:
    torch.manual_seed(0)
    save_extractor(folder / "w.safetensors", PublishedEfe((2, 2)), PublishedCard((2, 2)))


def _signed(folder: Path) -> Path:
    """The card names whatever weights lie there: else a change would be noticed before anything is parsed."""
    path = folder / "w.safetensors"
    if not path.is_file():  # a pipe would keep us waiting, a device has no end
        return path
    card = json.loads((folder / "w.json").read_text())
    card["sha256"] = hashlib.sha256(path.read_bytes()).hexdigest()
    (folder / "w.json").write_text(json.dumps(card))
    return path


def _taps(folder: Path) -> None:
    operator = SparseOperator(
        np.array([0, 2, 3], np.int64), np.array([1, 4, 2], np.int32), np.array([0.25, 0.75, 1.0], np.float32), 9
    )
    Taps(4, 4, np.array([3, 7], np.int32), np.array([0.5, 1.0], np.float32), operator).save(folder / "t", "key")


TARGETS = (
    Target("checkpoint-json", "checkpoint.json", _checkpoint, load_checkpoint, mutate_json),
    Target("checkpoint-tensors", STEP, _checkpoint, load_checkpoint),
    Target("training-json", "checkpoint.json", _training, _restored, mutate_json),
    Target("extractor-card", "w.json", _extractor, lambda f: load_extractor(f / "w.safetensors"), mutate_json),
    Target("extractor-weights", "w.safetensors", _extractor, lambda f: load_extractor(_signed(f)), signs=True),
    Target("published-card", "w.json", _published, lambda f: load_published(f / "w.safetensors"), mutate_json),
    Target("published-weights", "w.safetensors", _published, lambda f: load_published(_signed(f)), signs=True),
    Target("taps", "t", _taps, lambda f: Taps.load(f / "t", "key")),
)
