"""The library's own entry: a data set, detectors and a method in, a camouflage in memory out."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rauca_core.attack import make_settings, optimize, run_optimization, settings_of
from rauca_core.contract import Dataset, RaucaError, load_camouflage
from rauca_core.runtime.devices import find_device
from rauca_core.runtime.images import read_image

SMALL: dict[str, Any] = {"batch": 2, "map_size": 64, "samples": 2}


def test_without_a_folder_the_camouflage_is_in_memory(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    seen: list[Any] = []
    found = optimize(dataset.folder, [small_detector], steps=3, on_step=seen.append, **SMALL)
    assert (found.path, found.texture.shape, found.texture.dtype) == (None, (64, 64, 3), np.uint8)
    assert [row["loss"] for row in found.history] == [report.loss for report in seen]
    saved, image = load_camouflage(found.save(tmp_path / "paint.json"))
    assert saved == found.record
    assert (read_image(image) == found.texture).all()


def test_it_is_the_run_of_the_methods_settings(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    chosen = make_settings(**settings_of("fca", steps=4, lr=0.02, **SMALL))
    path = run_optimization(dataset, [small_detector], chosen, tmp_path / "run")
    optimize(dataset, [small_detector], "fca", steps=2, lr=0.02, out=tmp_path / "mine", **SMALL)
    found = optimize(dataset, [small_detector], "fca", steps=4, lr=0.02, out=tmp_path / "mine", resume=True, **SMALL)
    assert found.path == tmp_path / "mine" / "camouflage.json"
    assert found.path.read_bytes() == path.read_bytes()
    assert found.path.with_suffix(".png").read_bytes() == path.with_suffix(".png").read_bytes()


def test_without_a_device_a_gpu_is_taken_and_the_log_says_so(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert find_device(None) == torch.device("cpu")
    assert not caplog.text
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    with contextlib.suppress(RaucaError):  # where there is none after all
        assert find_device(None).type == "cuda"
    assert "no device named: working on a GPU" in caplog.text


def test_what_is_unknown_is_refused(dataset: Dataset, small_detector: Any) -> None:
    with pytest.raises(RaucaError, match="method: no 'best'"):
        optimize(dataset, [small_detector], "best", **SMALL)
    with pytest.raises(RaucaError, match="speed"):
        optimize(dataset, [small_detector], speed=3)
    with pytest.raises(RaucaError, match="device cuda:99"):
        optimize(dataset, [small_detector], device="cuda:99", **SMALL)
    with pytest.raises(RaucaError, match="no-such-detector"):
        optimize(dataset, ["no-such-detector"], **SMALL)
