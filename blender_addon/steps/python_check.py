"""What an external Python needs to optimize camouflages, and what it lacks, in words. No Blender in here."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..jobs.background import JobUpdate

MARK = "rauca-python "
OLDEST = (3, 11)
# Runs in whatever Python the user names, a very old one too. It tells after every finding: an import may crash it.
PROBE = f"""
import json, sys
sys.path = [path for path in sys.path if path]
told = {{"version": list(sys.version_info[:3])}}
def tell(**more):
    told.update(more)
    print({MARK!r} + json.dumps(told))
    sys.stdout.flush()
tell()
if sys.version_info[:2] < {OLDEST!r}:
    sys.exit(0)
try:
    import torch
    device = torch.cuda.get_device_name(0) if torch.cuda.is_available() else "CPU"
    tell(torch=torch.__version__, device=device)
except Exception as error:
    tell(torch_lacks=str(getattr(error, "name", "")), torch_error=str(error))
    sys.exit(0)
try:
    import inspect, rauca_core
    from pipelines.optimize import optimize
    from rauca_core.detect.weights import ready_names
    speaks = "json_progress" in inspect.signature(optimize).parameters
    tell(rauca=rauca_core.__version__, speaks=speaks, detectors=ready_names())
except Exception as error:
    tell(rauca_lacks=str(getattr(error, "name", "")), rauca_error=str(error))
"""


@dataclass(frozen=True)
class Verdict:
    """Whether a Python will do.

    Attributes:
        ready: it will.
        text: what is there, or what is missing and what to do; in English, for translation, then ``format(**values)``.
        values: what fills ``text``.
        detectors: names of those whose weights are there.
    """

    ready: bool
    text: str
    values: Mapping[str, str] = field(default_factory=dict)
    detectors: Sequence[str] = ()


@dataclass
class CheckTask:
    """Asks a Python what it has.

    Attributes:
        python: the program.
        found: what it told so far.
    """

    python: Path
    found: dict[str, Any] = field(default_factory=dict)

    @property
    def folder(self) -> Path:
        return self.python.parent

    def command(self) -> list[str]:
        return [str(self.python), "-c", PROBE]

    def hear(self, line: str) -> JobUpdate | None:
        if not line.startswith(MARK):
            return None
        self.found = json.loads(line.removeprefix(MARK))
        return JobUpdate()

    def clean(self) -> None:
        pass


def verdict(python: Path, found: Mapping[str, Any]) -> Verdict:
    """Judge what the probe told of ``python``, or the most that can be said when it told nothing."""
    if not python.is_file():
        return Verdict(False, "{python} is not there; choose the Python in which rauca is installed", _named(python))
    if not found:
        return Verdict(False, "{python} is not a Python; choose the one in which rauca is installed", _named(python))
    version = ".".join(map(str, found["version"]))
    if tuple(found["version"][:2]) < OLDEST:
        text = "Python {version} is too old: choose 3.11 or newer, with torch and rauca installed in it"
        return Verdict(False, text, {"version": version})
    if "torch" not in found:
        return _without_torch(python, found)
    if "rauca" not in found:
        return _without_rauca(python, found)
    if not found["speaks"]:
        text = "Its rauca {rauca} is older than this extension: run {python} -m pip install --upgrade rauca"
        return Verdict(False, text, {**_named(python), "rauca": found["rauca"]})
    if not found["detectors"]:
        return Verdict(False, "There are no detectors yet: run rauca weights fetch --all in a terminal")
    values = {key: str(found[key]) for key in ("torch", "device", "rauca")}
    count = str(len(found["detectors"]))
    text = "Python {version} with torch {torch} on {device}, rauca {rauca} and {count} detectors"
    return Verdict(True, text, {**values, "version": version, "count": count}, found["detectors"])


def _without_torch(python: Path, found: Mapping[str, Any]) -> Verdict:
    if found.get("torch_lacks") == "torch":
        return Verdict(False, "torch is missing: run {python} -m pip install torch", _named(python))
    if "torch_error" in found:
        text = "torch does not load ({error}); install it again: {python} -m pip install --force-reinstall torch"
        return Verdict(False, text, {**_named(python), "error": str(found["torch_error"])})
    text = "torch brings {python} down; install it again: {python} -m pip install --force-reinstall torch"
    return Verdict(False, text, _named(python))


def _without_rauca(python: Path, found: Mapping[str, Any]) -> Verdict:
    lacks = found.get("rauca_lacks", "")
    if lacks.partition(".")[0] in ("rauca_core", "pipelines"):
        return Verdict(False, "rauca is missing: run {python} -m pip install rauca", _named(python))
    text = "rauca does not load ({error}); install it again: {python} -m pip install --force-reinstall rauca"
    return Verdict(False, text, {**_named(python), "error": str(found.get("rauca_error", "it crashes"))})


def _named(python: Path) -> dict[str, str]:
    return {"python": str(python)}
