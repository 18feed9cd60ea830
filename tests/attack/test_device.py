"""A whole run on a device that is not the CPU: nothing of a step is left behind on either side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rauca_core.attack import make_settings, run_optimization
from rauca_core.attack.checkpoint import load_checkpoint
from rauca_core.attack.optimizer import CHECKPOINTS
from rauca_core.contract import Dataset
from rauca_core.runtime.distributed import SINGLE_PROCESS, Processes
from tests.pretend_device import DEVICE, PretendDevice

AFAR = Processes(0, 1, DEVICE)
PATTERN = {"paint": "pattern", "pattern_side": 16, "smooth": "picture", "prior": "background", "gamma": 0.5}


def run(dataset: Dataset, detector: Any, out: Path, processes: Processes, **chosen: Any) -> np.ndarray:
    """What was optimized after two steps and two more of a resumed run."""
    small = {"batch": 2, "map_size": 64, "samples": 2, "lr": 0.03, "beta": 3.0}
    for steps in (2, 4):
        run_optimization(
            dataset,
            [detector],
            make_settings(steps=steps, **small, **chosen),
            out,
            resume=steps == 4,
            processes=processes,
        )
    return load_checkpoint(out / CHECKPOINTS).tensors["parameter"].numpy()


@pytest.mark.parametrize("chosen", [{}, {"detector_size": 48, "smooth": "picture"}, PATTERN], ids=str)
def test_a_run_on_a_device_ends_where_one_on_the_cpu_does(
    dataset: Dataset, small_detector: Any, tmp_path: Path, chosen: dict[str, Any]
) -> None:
    here = run(dataset, small_detector, tmp_path / "here", SINGLE_PROCESS, **chosen)
    with PretendDevice():
        there = run(dataset, small_detector, tmp_path / "there", AFAR, **chosen)
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
