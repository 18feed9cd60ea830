"""The wall clock jumps, and files carry times of other decades: nothing that is made depends on either."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.faults.jobs import JOBS, Begun, GoesOn, Job, each
from tests.faults.running import Surroundings

DECADE_S = 315_000_000


@each(*JOBS)
def test_clock_jumps(job: Job, goes_on: GoesOn, begun: Begun, clock: Path | None, tmp_path: Path) -> None:
    if clock is None:
        pytest.skip("no C compiler (cc): there is no clock to turn back")
    out = begun(job, tmp_path / "out")
    for number, path in enumerate(sorted(out.rglob("*"))):
        os.utime(path, (DECADE_S * (1 + number % 6),) * 2)  # from 1980 to 2030, in no order
    goes_on(job, out, Surroundings(environment={"RAUCA_CLOCK": "jumps"}))


def test_the_clock_does_jump(clock: Path | None, tmp_path: Path) -> None:
    """What the others rely on: a process under it sees hours pass between two reads, both ways."""
    if clock is None:
        pytest.skip("no C compiler (cc): there is no clock to turn back")
    code = "import time; t = [time.time() for _ in range(99)]; d = [b - a for a, b in zip(t, t[1:])]"
    code += "; print(min(d), max(d))"
    environment = {**os.environ, "LD_PRELOAD": str(clock), "RAUCA_CLOCK": "jumps"}
    told = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    least, most = map(float, told.stdout.split())
    assert least < -3600 < 3600 < most
