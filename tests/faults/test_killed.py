"""SIGTERM and SIGKILL in the middle of the work: the same command goes on and ends in the same bits."""

from __future__ import annotations

import signal
from pathlib import Path

from tests.faults.jobs import JOBS, Begun, GoesOn, Inputs, Job, each
from tests.faults.running import Running


@each(*JOBS)
def test_sigterm(job: Job, goes_on: GoesOn, begun: Begun, tmp_path: Path) -> None:
    """It ends in one line and exit code 2 (`begun` sees to that); what was finished is not made again."""
    out = begun(job, tmp_path / "out")
    assert job.pulse(out) != job.pulse(tmp_path / "nowhere")
    goes_on(job, out)


@each(*JOBS)
def test_sigkill(job: Job, inputs: Inputs, goes_on: GoesOn, begun: Begun, tmp_path: Path) -> None:
    out = begun(job, tmp_path / "out")
    before = job.pulse(out)
    running = Running(job.words(inputs, out), tmp_path / "log")
    running.until(lambda: job.pulse(out) != before).signal(signal.SIGKILL)
    assert running.wait().code == -signal.SIGKILL
    goes_on(job, out)
