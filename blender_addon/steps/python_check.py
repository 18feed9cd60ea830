"""What an external Python needs to optimize camouflages, and what it lacks, in words."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bpy.app.translations import pgettext_rpt as rpt

from ..jobs.background import JobUpdate, Task

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


@dataclass
class CheckTask(Task):
    """Asks a Python what it has.

    Attributes:
        found: what it told so far.
    """

    found: dict[str, Any] = field(default_factory=dict)

    @staticmethod
    def of(python: Path) -> CheckTask:
        return CheckTask(python.parent, [str(python), "-c", PROBE])

    def hear(self, line: str) -> JobUpdate | None:
        if not line.startswith(MARK):
            return None
        self.found = json.loads(line.removeprefix(MARK))
        return JobUpdate()


def verdict(python: Path, found: Mapping[str, Any]) -> tuple[bool, str, str]:
    """Whether a Python will do, by what the probe told; what is there or missing, translated; what would mend it.

    ``found`` is empty when it told nothing.
    """
    lack, command = _lack(python, found)
    words = lack or rpt("Python {version} with torch {torch} on {device}, rauca {rauca} and {count} detectors")
    known = {"rauca_error": "it crashes", **found, "version": ".".join(map(str, found.get("version", ())))}
    told = words.format(**known, python=python, count=len(found.get("detectors", ())))
    return not lack, told, f"{shlex.quote(str(python))} -m {command}" if command else ""


def _lack(python: Path, found: Mapping[str, Any]) -> tuple[str, str]:
    """What is lacking, and what the Python is to run for it."""
    if not python.is_file():
        return rpt("{python} is not there; choose the Python in which rauca is installed, or press Make a Python"), ""
    if not found:
        return rpt("{python} is not a Python; choose the one in which rauca is installed"), ""
    if tuple(found["version"][:2]) < OLDEST:
        return rpt("Python {version} is too old: choose 3.11 or newer, or press Make a Python"), ""
    if found.get("torch_lacks") == "torch":
        return rpt("torch is missing: press Make a Python, or run the copied command"), "pip install torch"
    again = "pip install --force-reinstall "
    if "torch_error" in found:
        return rpt("torch does not load ({torch_error}): install it again, by the copied command"), again + "torch"
    if "torch" not in found:
        return rpt("torch brings this Python down: install it again, by the copied command"), again + "torch"
    if found.get("rauca_lacks", "").partition(".")[0] in ("rauca_core", "pipelines"):
        return rpt("rauca is missing: press Make a Python, or run the copied command"), "pip install rauca"
    if "rauca" not in found:
        return rpt("rauca does not load ({rauca_error}): install it again, by the copied command"), again + "rauca"
    if not found["speaks"]:
        words = rpt("Its rauca {rauca} is older than this extension: bring it up to date, by the copied command")
        return words, "pip install --upgrade rauca"
    if not found["detectors"]:
        return rpt("There are no detectors yet: press Fetch Detectors"), "pipelines weights fetch --all"
    return "", ""
