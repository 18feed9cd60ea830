"""Makes a Python of its own for what Blender's cannot do, as a program: ``python make_python.py FOLDER PACKAGE...``.

Only the standard library in here: it runs in Blender's Python, outside Blender. Progress are lines on standard output
as `contract.Progress` writes them; a mistake is one line on standard error. What is not finished is removed.
"""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import NoReturn

TOLD = ("Collecting", "Downloading", "Using", "Building", "Installing")  # words of pip that a user understands


def main(folder: Path, packages: Sequence[str]) -> int:
    """Make ``folder`` anew, an environment with the packages; returns the exit code."""
    shutil.rmtree(folder, ignore_errors=True)
    try:
        _tell(0, len(packages), "Python")
        _run([sys.executable, "-m", "venv", str(folder)])
        python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
        for number, package in enumerate(packages):
            _tell(number, len(packages), package)
            _run(
                [str(python), "-m", "pip", "install", "--no-input", "--progress-bar", "off", package],
                lambda line, number=number: _tell(number, len(packages), line),
            )
    except _FailedError as failed:
        shutil.rmtree(folder, ignore_errors=True)
        print(f"error: {failed}", file=sys.stderr, flush=True)
        return 2
    except KeyboardInterrupt:
        shutil.rmtree(folder, ignore_errors=True)
        print("interrupted: nothing is left of it", file=sys.stderr, flush=True)
        return 2
    _tell(len(packages), len(packages), "")
    return 0


class _FailedError(Exception):
    """In words that say what to do."""


def _run(command: Sequence[str], hear: object = None) -> None:
    """Run a program and hear what it says; it ends with this one."""
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
    assert child.stdout is not None
    said: list[str] = []
    try:
        for line in child.stdout:
            said = [*said[-50:], line.strip()]
            if callable(hear) and line.startswith(TOLD):
                hear(" ".join(line.split()[:2]))
        code = child.wait()
    except BaseException:
        child.kill()
        child.wait()
        raise
    if code:
        raise _FailedError(_reason(said))


def _reason(said: Sequence[str]) -> str:
    text = "\n".join(said)
    if "ensurepip" in text:
        return "Blender's Python cannot make environments; on Debian install python3-venv, or choose another Python"
    if "No matching distribution" in text or "ResolutionImpossible" in text:
        return "pip does not find the package for this Python; choose its wheel under Package, or see to the network"
    if "No space left" in text:
        return "the disk is full; free some space, then press the button again"
    errors = [line.removeprefix("ERROR:").strip() for line in said if line.startswith("ERROR")]
    return f"pip could not install it ({(errors or [*said, 'no reason given'])[-1]}); see to the network, press again"


def _tell(done: int, total: int, what: str) -> None:
    line = {"done": done, "total": total, "last": what, "left_s": None}
    print("rauca-progress " + json.dumps(line), flush=True)


def _interrupt(number: int, stack: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


if __name__ == "__main__":
    for name in ("SIGTERM", "SIGBREAK"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _interrupt)
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
