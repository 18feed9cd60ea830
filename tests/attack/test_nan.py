"""NaN stops a run by the frame's name, leaves what was good, and is forgotten once the frame is mended."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rauca_core.attack import DetectorEnsemble, make_settings, read_history, run_optimization
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset, FramePasses, RaucaError, load_frame, save_frame
from rauca_core.contract.files import TEMPORARY_PREFIX
from rauca_core.detect.interface import check_images
from rauca_core.runtime.tensor_files import CHECKPOINTS, load_checkpoint

SETTINGS = make_settings(steps=8, batch=2, map_size=32, samples=2, checkpoint_every=1, memory_mb=64)


def poison(dataset: Dataset, frame_id: str) -> None:
    """Light maps that are NaN in one pixel, as a renderer's bug leaves them."""
    folder = dataset.frame_folder(frame_id)
    stored = np.load(folder / "passes.npz")
    A, B = stored["A"].astype(np.float32), stored["B"].astype(np.float32)
    A[10, 20, 1] = np.nan
    flat = np.zeros(A.shape[:2], np.float32)
    save_frame(folder, load_frame(folder), FramePasses(np.zeros_like(A), flat, flat, flat, A, B))


def test_a_poisoned_frame_stops_the_run_and_a_mended_one_goes_on(
    dataset: Dataset, small_detector: Any, tmp_path: Path
) -> None:
    run_optimization(dataset, [small_detector], SETTINGS, tmp_path / "whole")
    fresh = Run(dataset, DetectorEnsemble([small_detector], "car"), SETTINGS)
    bad = fresh.store.frames[fresh.order.upcoming()[5]].id  # of the third step
    fresh.close()
    folder, out = dataset.frame_folder(bad), tmp_path / "out"
    shutil.copytree(folder, tmp_path / "good")
    poison(dataset, bad)
    with pytest.raises(RaucaError, match=f"{bad}/passes.npz: A holds NaN or infinity; .*render it again"):
        run_optimization(dataset, [small_detector], SETTINGS, out)
    kept = load_checkpoint(out / CHECKPOINTS)
    assert 0 < kept.step < 3
    assert all(torch.isfinite(tensor).all() for tensor in kept.tensors.values())
    assert [line["step"] for line in read_history(out)] == list(range(1, kept.step + 1))
    assert not (out / "camouflage.json").exists()
    assert not (out / "camouflage.png").exists()
    assert not list(out.rglob(TEMPORARY_PREFIX + "*"))

    shutil.rmtree(folder)
    shutil.copytree(tmp_path / "good", folder)
    run_optimization(dataset, [small_detector], SETTINGS, out, resume=True)
    assert (out / "camouflage.png").read_bytes() == (tmp_path / "whole" / "camouflage.png").read_bytes()


def test_light_that_turns_nan_on_the_way_is_named_though_the_detector_sees_it_first(
    dataset: Dataset, small_detector: Any
) -> None:
    """Estimated light is not read from a file that could be checked; real detectors refuse the picture, unnamed."""
    dense = small_detector.dense
    small_detector.dense = lambda images: (check_images("small", images), dense(images))[1]
    run = Run(dataset, DetectorEnsemble([small_detector], "car"), SETTINGS)
    bad, source = run.store.frames[run.order.upcoming()[1]].id, run.store.light

    def of(frame: Any) -> Any:
        light, image = source.of(frame)
        return (replace(light, A=light.A * np.float32(np.nan)) if frame.id == bad else light), image

    run.store.light = replace(source, of=of)
    before = run.texture.texels().detach().clone()
    try:
        with pytest.raises(RaucaError, match=f"step 1: the picture of frame {bad} is not finite"):
            run.advance()
    finally:
        run.close()
    assert torch.equal(run.texture.texels(), before)
