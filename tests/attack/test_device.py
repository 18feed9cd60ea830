"""A whole run on a device that is not the CPU: nothing of a step is left behind on either side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rauca_core.attack import METHODS, make_settings, run_optimization, settings_of
from rauca_core.attack.naturalness import Naturalness
from rauca_core.contract import Dataset
from rauca_core.runtime.distributed import SINGLE_PROCESS, Processes
from rauca_core.runtime.tensor_files import CHECKPOINTS, load_checkpoint
from tests.pretend_device import DEVICE, PretendDevice

AFAR = Processes(0, 1, DEVICE)
PALETTE = ("#101010", "#4b5320", "#f0f0f0")
CHOSEN: dict[str, dict[str, Any]] = {
    "defaults": {},
    "resized": {"detector_size": 48, "smooth": "picture"},
    "palette": {"natural": Naturalness(palette=PALETTE, feature_cm=50, reference="#8c8c8c", max_delta_e=60)},
    "reference": {"natural": Naturalness(reference="#8c8c8c"), "prior": "reference", "gamma": 1.0},
    "bfloat16": {"precision": "bfloat16"},
    **{method: settings_of(method) for method in METHODS},
}


def run(dataset: Dataset, detector: Any, out: Path, processes: Processes, **chosen: Any) -> np.ndarray:
    """What was optimized after two steps and two more of a resumed run."""
    small = {"batch": 2, "map_size": 64, "samples": 2, "lr": 0.03, "beta": 3.0, "pattern_side": 16, "decay": 1.0}
    for steps in (2, 4):
        settings = make_settings(**{**chosen, **small, "steps": steps})
        run_optimization(dataset, [detector], settings, out, processes=processes)
    return load_checkpoint(out / CHECKPOINTS).tensors["parameter"].numpy()


@pytest.mark.parametrize("case", CHOSEN)
def test_a_run_on_a_device_ends_where_one_on_the_cpu_does(
    dataset: Dataset, small_detector: Any, tmp_path: Path, case: str
) -> None:
    here = run(dataset, small_detector, tmp_path / "here", SINGLE_PROCESS, **CHOSEN[case])
    with PretendDevice():
        there = run(dataset, small_detector, tmp_path / "there", AFAR, **CHOSEN[case])
    assert np.abs(there - here).max() < 1e-3
    assert (tmp_path / "there" / "camouflage.png").is_file()


def test_the_pretended_device_refuses_what_a_gpu_does() -> None:
    with PretendDevice():
        far = torch.ones(3).to(DEVICE)
        assert (far + 1).device == DEVICE
        assert (far + 1).cpu().tolist() == [2.0, 2.0, 2.0]
        with pytest.raises(RuntimeError, match="does not"):
            far + torch.ones(3)
        with pytest.raises(RuntimeError, match="numpy"):
            far.numpy()
