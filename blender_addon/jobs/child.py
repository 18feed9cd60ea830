"""A job of this add-on in a process of its own: what starts it, and how it ended, in words that say what to do."""

from __future__ import annotations

import signal
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import bpy


def child_command(job: Path) -> list[str]:
    """The command that runs ``headless.main`` on a job's file, under the name that Blender gave the add-on."""
    package, root = str(__package__).rpartition(".")[0], str(Path(__file__).resolve().parents[2])
    # Blender finds extensions (bl_ext...) by itself; a checkout must come before an installed copy.
    where = "" if "." in package else f"sys.path.insert(0, {root!r}); "
    code = f"import sys, importlib; {where}sys.exit(importlib.import_module({package + '.headless'!r}).main())"
    if blender := bpy.app.binary_path:
        return [blender, "-b", "--python-exit-code", "3", "--python-expr", code, "--", str(job)]
    return [sys.executable, "-c", code, str(job)]


# The jobs speak of their command line; here a button is what the user has.
IN_THE_WINDOW = (
    ("run the same command with --retry-quarantined to try them again", "tick Retry Failed and start again"),
    ("run the same command with --resume", "start again to go on"),
    ("run the same command again", "start again"),
    ("run the same command to go on", "start again to go on"),
    ("or pass --no-denoise with 64 samples or more", "or turn Denoise off and take 64 samples or more"),
    ("choose another output folder", "choose another folder"),
    ("data set", "dataset"),
)


@dataclass(frozen=True)
class Ending:
    """A sentence about how a job ended.

    Attributes:
        phase: what became of the job.
        text: in English, for translation; then ``format(**values)``.
        values: what fills ``text``.
    """

    phase: Literal["done", "stopped", "failed"]
    text: str
    values: Mapping[str, str] = field(default_factory=dict)


FINISHED = Ending("done", "Finished")
STOPPED = Ending("stopped", "Stopped; what is finished is kept. Start again to go on")


def ending(code: int, complaints: Sequence[str]) -> Ending:
    """How a child ended that nobody asked to.

    Args:
        code: its exit code, not 0; negative for a signal.
        complaints: what it said on standard error, oldest first.
    """
    for line in reversed(complaints):
        if line.startswith("error: "):
            reason = with_buttons(line.removeprefix("error: "))
            return Ending("failed", "{reason}", {"reason": reason[:1].upper() + reason[1:]})
        if line.startswith("interrupted: "):
            return Ending("failed", "It was interrupted from outside; what is finished is kept. Start again to go on")
    if code == -signal.SIGKILL:
        text = "It was killed, perhaps for want of memory; what is finished is kept. Close other programs, start again"
        return Ending("failed", text)
    if code < 0:
        text = "It crashed ({signal}); what is finished is kept. Start again to go on"
        return Ending("failed", text, {"signal": signal.Signals(-code).name})
    last = complaints[-1] if complaints else "no message"
    return Ending("failed", "It broke off with code {code}: {last}", {"code": str(code), "last": last})


def with_buttons(sentence: str) -> str:
    """A sentence of the command line as one for the window: it tells of buttons, not of commands."""
    for there, here in IN_THE_WINDOW:
        sentence = sentence.replace(there, here)
    return sentence
