"""What a user is told when Blender is missing or died."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.in_blender import open_vehicle
from rauca_core.contract import ApplyCamouflage, Progress, RaucaError
from rauca_core.contract.system import cores, in_blender
from rauca_core.runtime.blender import LIBRARIES, blender_command, reason_of, require_bpy, run_blender, run_blenders
from tools.system_libraries import PACKAGES


def test_a_missing_blender_is_told_with_what_would_do_without_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "bpy", None)
    with pytest.raises(RaucaError, match=r"^Blender is missing: .*Python 3.12\)$"):
        require_bpy()
    with pytest.raises(RaucaError, match=r"or pass --blender PROGRAM$"):
        blender_command(tmp_path / "job.json")
    with pytest.raises(RaucaError, match=r"or give a vehicle folder$"):
        open_vehicle(str(tmp_path / "car.glb"))


@pytest.mark.parametrize(
    ("code", "told"),
    [
        ("import os; os.kill(os.getpid(), 9)", r"killed by SIGKILL \(out of memory\?\)"),
        ("import sys; print('RuntimeError: boom\\n', file=sys.stderr); sys.exit(3)", "code 3: RuntimeError: boom$"),
        ("import sys; print('error: the disk is full\\nbye', file=sys.stderr); sys.exit(2)", "^the disk is full$"),
    ],
)
def test_a_job_that_dies_is_told_with_its_reason(monkeypatch: pytest.MonkeyPatch, code: str, told: str) -> None:
    monkeypatch.setattr("rauca_core.runtime.blender.blender_command", lambda *_: [sys.executable, "-c", code])
    with pytest.raises(RaucaError, match=told):
        run_blender(ApplyCamouflage(Path(), Path()), lambda _: None)


def test_the_first_that_fails_ends_the_others(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Two jobs: one tells how far it is and waits for ever, the other dies of what is wrong."""
    waits = f"print({Progress(1, 4, 'a frame', 9.0).line()!r}, flush=True); import time; time.sleep(600)"
    fails = "import sys, time; time.sleep(1); print('error: the disk is full', file=sys.stderr); sys.exit(2)"
    codes, told = iter((waits, fails)), []
    monkeypatch.setattr("rauca_core.runtime.blender.blender_command", lambda *_: [sys.executable, "-c", next(codes)])
    job = ApplyCamouflage(tmp_path, tmp_path)
    with pytest.raises(RaucaError, match=r"^the disk is full$"):
        run_blenders([job, job], told.append)
    assert told == [Progress(1, 4, "a frame", 9.0)]


def test_progress_is_that_of_all(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    says = (f"print({Progress(done, 3, 'x', left).line()!r})" for done, left in ((2, None), (1, 5.0)))
    monkeypatch.setattr("rauca_core.runtime.blender.blender_command", lambda *_: [sys.executable, "-c", next(says)])
    told: list[Progress] = []
    run_blenders([ApplyCamouflage(tmp_path, tmp_path)] * 2, told.append)
    assert told[-1] == Progress(3, 6, "x", 5.0)


@pytest.mark.skipif(cores() < 2, reason="a single core has no threads to leave out")
def test_blender_has_no_idle_threads_beside_those_it_renders_with() -> None:
    """They would spin, and slow the process beside it; whatever else the process starts may use every core."""
    code = "import os, bpy; print(len(os.listdir('/proc/self/task')), len(os.sched_getaffinity(0)))"

    def told(threads: int) -> list[int]:
        command = in_blender(code, Path("job.json"), threads=threads)
        return list(map(int, subprocess.run(command, capture_output=True, check=True, text=True).stdout.split()))

    (few, allowed), (many, all_cores) = told(1), told(0)
    assert few < many
    assert allowed == all_cores == cores()


def test_a_blender_program_is_told_its_threads(tmp_path: Path) -> None:
    program = tmp_path / "blender"
    program.touch()
    assert blender_command(Path("job.json"), program, 3)[1:4] == ["-b", "-t", "3"]
    assert "-t" not in blender_command(Path("job.json"), program)


def test_a_library_that_the_system_lacks_is_named_with_the_packages_that_bring_it() -> None:
    told = "libX11.so.6: cannot open shared object file: No such file or directory"
    for complaint in (f"ImportError: {told}\n", f"blender: error while loading shared libraries: {told}\n"):
        reason = reason_of("bake", 127, [complaint])
        assert told in reason
        assert reason.endswith(f"; on Debian: apt-get install {LIBRARIES}")
    assert LIBRARIES.split() == list(PACKAGES.values())  # what `make` installs
