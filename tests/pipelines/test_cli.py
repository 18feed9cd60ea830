"""The `rauca` command as users type it."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from inspect import signature
from pathlib import Path

import pytest
import typer

from pipelines.detector_commands import weights_app
from pipelines.efe_commands import efe_train
from rauca_core.detect.weights import OWN_FOLDER
from rauca_core.training.settings import ExtractorSettings
from rauca_core.version import __version__


def rauca(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from pipelines.cli import run; run()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def command_lines() -> list[str]:
    """Of every process that runs, where the system tells (Linux)."""
    lines = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            lines.append(path.read_text(errors="replace"))
    return lines


def test_the_command_line_answers_without_torch():
    """Nothing that takes seconds to import is needed for help, data sets or mistakes."""
    heavy = "{'torch', 'numba', 'cv2', 'scipy', 'matplotlib'}"
    command = f"import sys; from pipelines.cli import run; print({heavy} & set(sys.modules))"
    told = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True).stdout
    assert told.strip() == "set()"


@pytest.mark.parametrize("chosen", [None, "ACTIVE"])
@pytest.mark.parametrize("program", ["cli", "optimize"])
def test_waiting_threads_sleep_unless_the_user_says_otherwise(program, chosen):
    """OpenMP looks once, when torch is loaded."""
    command = f"""
import os, sys
class Watch:
    def find_spec(self, name, *_):
        if name == "torch": sys.exit(print(os.environ.get("OMP_WAIT_POLICY")))
sys.meta_path.insert(0, Watch())
import pipelines.{program}, torch
"""
    around = {name: value for name, value in os.environ.items() if name != "OMP_WAIT_POLICY"}
    around |= {"OMP_WAIT_POLICY": chosen} if chosen else {}
    told = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True, env=around)
    assert told.stdout.strip() == (chosen or "PASSIVE")


def test_what_the_command_line_repeats_is_what_the_library_says():
    assert signature(efe_train).parameters["eta"].default == ExtractorSettings().eta
    (option,) = (o for o in typer.main.get_command(weights_app).commands["fetch"].params if "--from" in o.opts)
    assert option.envvar == OWN_FOLDER


def test_the_version_is_told():
    assert rauca("--version").stdout == f"rauca {__version__}\n"


def test_doctor_looks_at_everything():
    report = rauca("doctor")
    assert report.returncode in (0, 1)
    for what in ("python", "torch", "bpy", "denoiser", "weights yolov3-tiny"):
        assert what in report.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["report", "nowhere"], "nowhere: has no study.json"),
        (["optimize", "nowhere", "--out", "x"], "nowhere: not a data set"),
        (["optimize", "nowhere", "--out", "x", "--batch", "0"], "batch: input should be greater than"),
        (["weights", "fetch", "yolov9"], "yolov9"),
        (["apply", "c.json", "--out", "car.png"], "--out must end in .blend"),
        (["demo", "--blender", "/no/blender", "--out", "x"], "/no/blender: no such program"),
    ],
)
def test_mistakes_are_one_line_with_exit_code_two(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    refused = rauca(*arguments)
    assert refused.returncode == 2
    lines = [line for line in refused.stderr.splitlines() if line.startswith("error: ")]
    assert len(lines) == 1
    assert message in lines[0]
    assert "Traceback" not in refused.stderr


def test_ctrl_c_is_one_line_and_stops_blender_too(tmp_path):
    arguments = ["dataset", "make", "--out", str(tmp_path / "set"), "--size", "256", "--samples", "16"]
    command = [sys.executable, "-c", "from pipelines.cli import run; run()", *arguments]
    job = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not (tmp_path / "set" / "dataset.json").is_file() and time.monotonic() < deadline:
        time.sleep(0.1)
    job.send_signal(signal.SIGINT)
    _, complaint = job.communicate(timeout=90)
    assert job.returncode == 2
    assert complaint.strip().splitlines()[-1].startswith("error: interrupted; what was finished is kept")
    assert not list((tmp_path / "set").rglob(".partial-*"))
    assert not [line for line in command_lines() if str(tmp_path) in line]
