"""What a user is told when Blender is missing or died."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks.in_blender import open_vehicle
from rauca_core.contract import ApplyCamouflage, RaucaError
from rauca_core.runtime.blender import LIBRARIES, blender_command, reason_of, require_bpy, run_blender
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


def test_a_library_that_the_system_lacks_is_named_with_the_packages_that_bring_it() -> None:
    told = "libX11.so.6: cannot open shared object file: No such file or directory"
    for complaint in (f"ImportError: {told}\n", f"blender: error while loading shared libraries: {told}\n"):
        reason = reason_of("bake", 127, [complaint])
        assert told in reason
        assert reason.endswith(f"; on Debian: apt-get install {LIBRARIES}")
    assert LIBRARIES.split() == list(PACKAGES.values())  # what `make` installs
