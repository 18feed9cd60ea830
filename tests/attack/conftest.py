"""Data sets made by numpy in place of Blender, and a detector small enough to take many steps."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from benchmarks.stability.detectors import Answering, as_found
from benchmarks.stability.drawn import make_dataset
from rauca_core.contract import Dataset, Vehicle
from rauca_core.environment.extractor import PublishedEfe
from rauca_core.environment.weights import PublishedCard, save_extractor

torch.set_num_threads(1)


@pytest.fixture
def dataset(tmp_path: Path, box_vehicle: Vehicle) -> Dataset:
    return make_dataset(tmp_path / "data", box_vehicle, 64, (40.0, 130.0, 250.0))


@pytest.fixture
def small_detector() -> Answering:
    return Answering(as_found)


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """Of a small published extractor, drawn and never trained."""
    torch.manual_seed(0)
    path = tmp_path / "published.safetensors"
    save_extractor(path, PublishedEfe((4, 8)), PublishedCard((4, 8)))
    return path
