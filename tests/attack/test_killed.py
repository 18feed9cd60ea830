"""Runs that are killed with SIGKILL, in the middle of files too, end in the bits of one that was left alone."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import torch

from rauca_core.attack import read_history
from rauca_core.attack.history import PICTURE, UV_MAP
from rauca_core.contract import Dataset
from rauca_core.contract.files import TEMPORARY_PREFIX
from rauca_core.runtime.images import read_image
from rauca_core.runtime.tensor_files import CHECKPOINTS, load_checkpoint

SETTINGS = {"steps": 9, "batch": 2, "map_size": 32, "samples": 2, "checkpoint_every": 2, "lr": 0.03, "rest": 1}

# A process that starts the run again and again, each time in a child that dies as it is about to change a file: at the
# first or second change of that kind. Where a line is appended, half of it is written first.
KILLED = """
import json, os, shutil, signal, sys, torch
from pathlib import Path
from benchmarks.stability.detectors import SmallDetector
from rauca_core.attack import make_settings, run_optimization
from rauca_core.runtime.tensor_files import started
from rauca_core.contract import Dataset

torch.set_num_threads(1)
data, out, chosen = Dataset(Path(sys.argv[1])), Path(sys.argv[2]), make_settings(**json.loads(sys.argv[3]))
run_optimization(data, [SmallDetector()], chosen, out / "whole")  # first, so that children find their kernels loaded
shutil.rmtree(data.folder / "taps")
out = out / "killed"

def die_at(kind, named, time):
    change, seen = getattr(os, kind), 0
    def call(*given, **more):
        nonlocal seen
        seen += named in " ".join(Path(g).name for g in given if isinstance(g, (str, Path)))
        if seen == time:
            if kind == "write":
                change(given[0], given[1][: len(given[1]) // 2])
            os.kill(os.getpid(), signal.SIGKILL)
        return change(*given, **more)
    setattr(os, kind, call)

for moment in [*json.loads(sys.argv[4]), None]:
    child = os.fork()
    if child == 0:
        if moment is not None:
            die_at(*moment)
        run_optimization(data, [SmallDetector()], chosen, out, resume=started(out))
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert status == (0 if moment is None else signal.SIGKILL), (moment, status)
"""
MOMENTS = [
    ("replace", ".safetensors", 1),  # taps
    ("replace", "preview.png", 1),
    ("replace", "step-", 1),  # the first checkpoint, of step 2
    ("replace", "checkpoint.json", 1),
    ("replace", "checkpoint.json", 2),  # that of step 2 stands
    ("write", "", 1),  # a line of the history
    ("unlink", "step-", 1),  # of the old tensors: the new checkpoint stands
    ("replace", "step-", 2),
    ("write", "", 2),
    ("fsync", "", 2),
    ("replace", "camouflage.png", 1),
    ("replace", "camouflage.json", 1),
]


def test_killed_at_every_kind_of_change_of_a_file(dataset: Dataset, tmp_path: Path) -> None:
    out = tmp_path / "killed"
    command = [
        sys.executable,
        "-c",
        KILLED,
        str(dataset.folder),
        str(tmp_path),
        json.dumps(SETTINGS),
        json.dumps(MOMENTS),
    ]
    told = subprocess.run(
        command, cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=600, check=False
    )
    assert told.returncode == 0, told.stderr
    one, two = (load_checkpoint(folder / CHECKPOINTS) for folder in (tmp_path / "whole", out))
    assert set(one.tensors) == set(two.tensors)
    assert all(torch.equal(one.tensors[name], two.tensors[name]) for name in one.tensors)
    assert (out / "camouflage.png").read_bytes() == (tmp_path / "whole" / "camouflage.png").read_bytes()
    kept = [[(h["step"], h["loss"], h["score"]) for h in read_history(f)] for f in (tmp_path / "whole", out)]
    assert kept[0] == kept[1]
    assert not list(out.rglob(TEMPORARY_PREFIX + "*"))
    assert read_image(out / UV_MAP).shape == (32, 32, 3)
    assert read_image(out / PICTURE).shape == (32, 64, 3)
