"""How a child process ended, in words that say what to do."""

from __future__ import annotations

import signal
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

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

    @staticmethod
    def finished() -> Ending:
        return Ending("done", "Finished")

    @staticmethod
    def stopped() -> Ending:
        return Ending("stopped", "Stopped; what is finished is kept. Start again to go on")


def ending(code: int, complaints: Sequence[str]) -> Ending:
    """How a child ended that nobody asked to.

    Args:
        code: its exit code, not 0; negative for a signal.
        complaints: what it said on standard error, oldest first.
    """
    for line in reversed(complaints):
        if line.startswith("error: "):
            return Ending("failed", "{reason}", {"reason": in_the_window(line.removeprefix("error: "))})
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


def in_the_window(sentence: str) -> str:
    """A sentence of the command line as one for the window."""
    sentence = with_buttons(sentence)
    return sentence[:1].upper() + sentence[1:] if not sentence.startswith(("--", "/")) else sentence


def with_buttons(sentence: str) -> str:
    """The same sentence where it tells what to do next: buttons instead of commands."""
    for there, here in IN_THE_WINDOW:
        sentence = sentence.replace(there, here)
    return sentence
