"""Shards on a cluster: against a real Slurm where its programs are installed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pipelines.slurm import render_on_slurm, slurm_parser
from rauca_core.contract import RaucaError

PROGRAMS = ("sbatch", "slurmctld", "slurmd", "munged")
SCRIPT = Path(__file__).parent / "run.sh"


def test_two_shards_equal_a_local_run():
    pytest.importorskip("bpy", reason="the bpy wheel is not installed")
    pytest.importorskip("submitit", reason="submitit is not installed")
    if missing := [name for name in PROGRAMS if shutil.which(name) is None]:
        pytest.skip(f"no Slurm here ({', '.join(missing)} missing); {SCRIPT.name} installs it on Debian")
    done = subprocess.run([SCRIPT, sys.executable], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 shards made the same 6 frames as a local run" in done.stdout


def test_mistakes_are_told(tmp_path, monkeypatch):
    def submit(*arguments: str) -> None:
        options, rest = slurm_parser().parse_known_args(["--slurm", *arguments])
        render_on_slurm(options, tmp_path / "set", rest, None, lambda progress: None)

    with pytest.raises(RaucaError, match="give --shards N instead"):
        submit("--shard", "1/2")
    with pytest.raises(RaucaError, match="at least 1"):
        submit("--shards", "0")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RaucaError, match="no sbatch here; run this on a login node"):
        submit("--shards", "2")
    assert not list(tmp_path.iterdir())
