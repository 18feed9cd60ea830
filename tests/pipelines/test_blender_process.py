"""What a user is told when Blender is missing or died."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from benchmarks.in_blender import open_vehicle
from rauca_core.contract import RaucaError
from rauca_core.runtime.blender import LIBRARIES, blender_command, reason_of, require_bpy

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture
def _no_wheel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "bpy", None)


@pytest.mark.usefixtures("_no_wheel")
def test_a_missing_blender_is_told_with_what_would_do_without_it(tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match=r"^Blender is missing: .*Python 3.12\)$"):
        require_bpy()
    with pytest.raises(RaucaError, match=r"or pass --blender PROGRAM$"):
        blender_command(tmp_path / "job.json")
    with pytest.raises(RaucaError, match=r"or give a vehicle folder$"):
        open_vehicle(str(tmp_path / "car.glb"))


def test_a_blender_program_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match="blender: no such program"):
        blender_command(tmp_path / "job.json", tmp_path / "blender")


def test_how_a_job_died_is_told_by_its_own_sentence_or_its_signal() -> None:
    assert reason_of("bake", 2, ["x", "error: car.obj: no faces\n", "quit\n"]) == "car.obj: no faces"
    assert "killed by SIGKILL (out of memory?)" in reason_of("bake", -9, [])
    assert reason_of("bake", 11, ["last words\n", "\n"]) == "bake: Blender stopped with code 11: last words"


def test_a_library_that_the_system_lacks_is_named_with_the_packages_that_bring_it() -> None:
    told = "libX11.so.6: cannot open shared object file: No such file or directory"
    for complaint in (f"ImportError: {told}\n", f"blender: error while loading shared libraries: {told}\n"):
        reason = reason_of("bake", 127, [complaint])
        assert told in reason
        assert reason.endswith(f"; on Debian: apt-get install {LIBRARIES}")
    assert LIBRARIES in (REPOSITORY / "README.md").read_text(encoding="utf-8")
