"""A job of this add-on in a process of its own: what starts it, and how it ended, in words that say what to do."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import bpy
from bpy.app.translations import pgettext_rpt as rpt

from ..core import system


def child_command(job: Path, threads: int = 0) -> list[str]:
    """The command that runs ``headless.main`` on a job's file, under the name that Blender gave the add-on.

    Args:
        threads: of Blender; 0: as many as there are cores.
    """
    package, root = str(__package__).rpartition(".")[0], str(Path(__file__).resolve().parents[2])
    # Blender finds extensions (bl_ext...) by itself; a checkout must come before an installed copy.
    where = "" if "." in package else f"sys.path.insert(0, {root!r}); "
    code = f"import sys, importlib; {where}sys.exit(importlib.import_module({package + '.headless'!r}).main())"
    return system.in_blender(code, job, bpy.app.binary_path, threads)


# The jobs speak of their command line; here a button is what the user has.
IN_THE_WINDOW = (
    ("run the same command with --retry-quarantined to try them again", "tick Retry Failed and start again"),
    ("run the same command again", "start again"),
    ("run the same command to go on", "start again to go on"),
    ("or pass --no-denoise with 64 samples or more", "or turn Denoise off and take 64 samples or more"),
    ("choose another output folder", "choose another folder"),
    ("give its vehicle with --vehicle", "choose that vehicle in step 1, or another folder in step 4"),
    ("or render on the CPU with --render-device cpu", "or choose CPU under Render On"),
    ("drop the paint option", "leave its paint alone in step 1"),
    ("data set", "dataset"),
)
# Options that a sentence may name beside what it fills in, and the setting of the window that each one is.
SETTINGS = {
    "steps": "Steps", "batch": "Frames a Step", "map-size": "Texture Size", "seed": "Seed", "name": "Name",
    "detector": "Detectors", "detectors": "Detectors", "vehicle": "Vehicle", "paint-mask": "Paint Mask",
    "paint-material": "Material", "render-device": "Render On", "locations": "Locations", "weathers": "List",
    "no-denoise": "Denoise off", "scene": "the scene's file",
}  # fmt: skip


def ending(code: int, complaints: Sequence[str]) -> str:
    """How a child ended that nobody asked to, translated.

    Args:
        code: its exit code, not 0; negative for a signal.
        complaints: what it said on standard error, oldest first.
    """
    for line in reversed(complaints):
        if line.startswith("error: "):
            reason = rpt(with_buttons(line.removeprefix("error: ")))
            return reason[:1].upper() + reason[1:]
        if line.startswith("interrupted: "):
            return rpt("It was interrupted from outside; what is finished is kept. Start again to go on")
    killer = system.killed_by(code)
    if killer == "SIGKILL":
        return rpt(
            "It was killed, perhaps for want of memory; what is finished is kept. Close other programs, start again"
        )
    if killer:
        text = rpt("It crashed ({signal}); what is finished is kept. Start again to go on")
        return text.format(signal=killer)
    last = complaints[-1] if complaints else "no message"
    return rpt("It broke off with code {code}: {last}").format(code=code, last=last)


def with_buttons(sentence: str) -> str:
    """A sentence of the command line as one for the window: it tells of buttons, not of commands."""
    for there, here in IN_THE_WINDOW:
        sentence = sentence.replace(there, here)
    return re.sub(r"--([a-z-]*[a-z])", lambda option: SETTINGS.get(option[1], option[1].replace("-", " ")), sentence)
