"""The Python for optimizing, made by one click: a real environment, packages from a folder, cancelled and refused."""

from __future__ import annotations

import sys
import zipfile
from pathlib import Path

import pytest

from blender_addon.jobs import watch
from blender_addon.preferences import SETUP, preferences, python_bytes
from blender_addon.steps import python_setup
from rauca_core.contract import system

from .conftest import refusal
from .timer import until


def a_wheel(folder: Path, name: str, code: str) -> Path:
    """A wheel of one module, which wants nothing."""
    path, info = folder / f"{name}-1.0-py3-none-any.whl", f"{name}-1.0.dist-info"
    with zipfile.ZipFile(path, "w") as wheel:
        wheel.writestr(f"{name}.py", code)
        wheel.writestr(f"{info}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        kind = "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        wheel.writestr(f"{info}/WHEEL", kind)
        wheel.writestr(f"{info}/RECORD", "")
    return path


@pytest.fixture
def settings(addon, tmp_path, monkeypatch):
    """The preferences of a Blender that may go online, where pip finds packages in a folder of the test's alone."""
    shelf = tmp_path / "shelf"
    shelf.mkdir()
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(shelf))
    monkeypatch.setattr(python_setup, "own_folder", lambda: tmp_path / "own")
    monkeypatch.delenv("PYTHONPATH", raising=False)
    addon.context.preferences.system.use_online_access = True
    return preferences(addon.context)


def test_one_click_makes_a_python_and_sees_what_it_has(addon, settings, tmp_path):
    torch = "__version__ = '9'\nclass cuda:\n    is_available = staticmethod(lambda: False)\n"
    a_wheel(tmp_path / "shelf", "torch", torch)
    settings.package = str(a_wheel(tmp_path, "rauca", ""))  # a wheel that somebody was given
    assert addon.ops.rauca.make_python(wait=False) == {"FINISHED"}
    job = watch.job(SETUP)
    told = set()
    longest = until(lambda: told.add(job.doing) or not job.alive)
    assert job.phase == "done", job.ending
    assert longest < 0.1
    assert any(words.startswith("Processing") or "torch" in words for words in told)
    made = system.python_in(tmp_path / "own" / "python")
    assert settings.python == str(made)
    until(lambda: not watch.busy("check"))
    watch.tick()
    assert not settings.ready  # it is rauca's name, not its code
    assert settings.verdict.startswith("rauca is missing")
    assert settings.command == f"{made} -m pip install rauca"


def test_what_cannot_be_installed_is_told_and_leaves_nothing(addon, settings, tmp_path):
    with pytest.raises(RuntimeError, match="does not find the package"):
        addon.ops.rauca.make_python()
    assert "choose its wheel under Package" in settings.verdict
    assert not (tmp_path / "own" / "python").exists()


def test_it_can_be_stopped_and_leaves_nothing(addon, settings, tmp_path):
    addon.ops.rauca.make_python(wait=False)
    job = watch.job(SETUP)
    until(lambda: (tmp_path / "own" / "python").exists() or not job.alive)
    assert "It is being set up" in refusal(addon.ops.rauca.make_python)
    addon.ops.rauca.steer_job(job=SETUP, action="STOP")
    until(lambda: not job.alive)
    assert job.phase == "stopped"
    assert not (tmp_path / "own" / "python").exists()
    assert not settings.python


def test_room_and_leave_to_go_online_are_asked_for(addon, settings, monkeypatch):
    monkeypatch.setattr(python_setup, "python_bytes", lambda: 10**18)
    assert "free some space" in refusal(addon.ops.rauca.make_python)
    assert python_bytes() in (2 * 10**9, 8 * 10**9)
    addon.context.preferences.system.use_online_access = False
    for operator in (addon.ops.rauca.make_python, addon.ops.rauca.fetch_detectors):
        assert "Blender may not go online" in refusal(operator)


def test_detectors_are_fetched_by_the_python_itself(addon, settings, tmp_path):
    """What it runs is rauca's own command; here a stand-in notes the words."""
    noted = tmp_path / "noted"
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\necho "$@" >> {noted}\n')
    python.chmod(0o700)
    settings.python = str(python)
    addon.ops.rauca.fetch_detectors()
    assert noted.read_text().splitlines()[0] == "-P -m pipelines weights fetch --all"
    until(lambda: not watch.busy("check"))
    assert sys.executable != settings.python
