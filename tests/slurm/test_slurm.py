"""Shards on a cluster: against a real Slurm where its programs are installed."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipelines.cli import app
from rauca_core.contract import (
    LedgerEntry,
    MakeDataset,
    Progress,
    RaucaError,
    append_entry,
    balanced_frames,
    claim_folder,
    planned_frames,
)
from rauca_core.runtime.cluster import tell_frames
from tests.contract.samples import PLAN

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
        done = CliRunner().invoke(app, ["dataset", "make", "--out", str(tmp_path / "set"), *arguments])
        assert done.exception is not None
        raise done.exception

    with pytest.raises(RaucaError, match="give --shards N instead"):
        submit("--slurm", "--shard", "1/2")
    with pytest.raises(RaucaError, match="give --shards N instead"):
        submit("--slurm", "--shard=1/2")
    with pytest.raises(RaucaError, match="at least 1"):
        submit("--slurm", "--shards", "0")
    for alone in (["--shards", "2"], ["--partition=gpu"], ["--time", "5"], ["--no-wait"]):
        with pytest.raises(RaucaError, match=f"{alone[0].partition('=')[0]}: is of a Slurm cluster; give --slurm too"):
            submit(*alone)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RaucaError, match="no sbatch here; run this on a login node"):
        submit("--slurm", "--shards", "2")
    assert not list(tmp_path.iterdir())


def test_progress_counts_the_frames_that_were_asked_for(tmp_path):
    claim_folder(tmp_path, PLAN)
    part = balanced_frames(PLAN, 3)
    strangers = [frame.id for frame in planned_frames(PLAN) if frame.id not in part]
    for frame in [*part[:2], *strangers[:4]]:  # the strangers are of an earlier run
        append_entry(tmp_path, LedgerEntry(frame, "occluded", visible=0.1))
    job = MakeDataset(tmp_path, PLAN, frames=tuple(part))
    moves: list[Progress] = []
    tell_frames(job, "1 of 2 tasks left", moves.append)
    assert [(move.done, move.total) for move in moves] == [(2, 3)]
