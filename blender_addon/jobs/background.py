"""A job that can be paused, taken up again and stopped: one child process after another with the same aim.

Pausing ends the child at the next good moment (a frame or a step is finished first, everything is on disk) and going on
starts it again. A child that was frozen instead would keep its memory, its locks on the folder and a half-rendered
frame, and would hang for good if Blender died; this one loses nothing when Blender does.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from queue import SimpleQueue
from typing import Literal

import numpy as np
from bpy.app.translations import pgettext_rpt as rpt
from numpy.typing import NDArray

from ..core import child_process, contract
from .child import ending

Phase = Literal["starting", "running", "pausing", "paused", "stopping", "done", "stopped", "failed"]
NEWS_PER_TICK = 200
STOPPED = "Stopped; what is finished is kept. Start again to go on"


@dataclass(frozen=True)
class JobUpdate:
    """What a line of a child tells.

    Attributes:
        done, total: items finished, and in all; None when the line tells of something else.
        left_s: estimate of the seconds left, if known.
        note: something the user should know.
        figures: numbers by name, such as ``loss``, of the steps it tells of, oldest first.
        pictures: small (H, W, 3) sRGB bytes by name, row 0 at the top.
        doing: what is being done, where a job does several things in turn.
    """

    done: int | None = None
    total: int | None = None
    left_s: float | None = None
    note: str = ""
    figures: Sequence[Mapping[str, float]] = ()
    pictures: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict)
    doing: str = ""


@dataclass
class Task:
    """What a job does: a program that runs to its end.

    Attributes:
        folder: where its results go.
        start: the command.
        scratch: a folder that only the job needs, if any; removed at its end.
    """

    folder: Path
    start: Sequence[str]
    scratch: Path | None = None

    def command(self) -> list[str]:
        """Starts a child, or starts it again where an earlier one stopped."""
        return list(self.start)

    def hear(self, line: str) -> JobUpdate | None:
        """What a line of the child tells, here as rauca's commands do; called in a thread, no Blender in here."""
        told = contract.parse_progress(line)
        return None if told is None else JobUpdate(told.done, told.total, told.left_s, doing=told.last)

    def clean(self) -> None:
        """Remove what only the job needed."""
        if self.scratch is not None:
            shutil.rmtree(self.scratch, ignore_errors=True)


class Job:
    """A task at work.

    Attributes:
        phase: where it stands.
        done, total, left_s: progress; 0 of 0 until the child tells.
        doing: what that is the progress of, where a job does several things in turn.
        notes: what the child wants known, each once.
        history: each figure of every step, oldest first.
        pictures: the newest of each name, not yet shown.
        when_done: to be called in Blender's thread, once it has ended in any way.
        ending: how the job ended, translated, once ``phase`` is done, stopped or failed.
    """

    def __init__(self, task: Task, when_done: Callable[[Job], None] | None = None) -> None:
        """Start it; raises :class:`RaucaError` when the program cannot be started."""
        self.task, self.when_done = task, when_done
        self.when_paused: Callable[[Job], None] | None = None
        self.phase: Phase = "starting"
        self.done = self.total = 0
        self.left_s: float | None = None
        self.doing = ""
        self.notes: list[str] = []
        self.history: dict[str, list[float]] = {}
        self.pictures: dict[str, NDArray[np.uint8]] = {}
        self.ending = ""
        self._news: SimpleQueue[JobUpdate] = SimpleQueue()
        self._begin()

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def alive(self) -> bool:
        """Whether it still works or waits to go on."""
        return not self.ending

    @property
    def fraction(self) -> float:
        """Done so far, in [0, 1]."""
        return min(self.done / self.total, 1.0) if self.total else 0.0

    def tick(self) -> bool:
        """Hear what is new, without waiting; returns whether anything changed."""
        if not self.alive or self.phase == "paused":
            return False
        code = self._process.code()  # first: what was said before the end is heard below
        taken = 0
        while taken < NEWS_PER_TICK and not self._news.empty():
            self._take(self._news.get())
            taken += 1
        if code is not None and taken < NEWS_PER_TICK:
            self._end(code)
            return True
        return taken > 0

    def pause(self) -> None:
        """Let the child finish what it has in hand, then wait for :meth:`go_on`."""
        if self.phase in ("starting", "running"):
            self.phase = "pausing"
            self._process.stop()

    def go_on(self) -> None:
        """After a pause; raises :class:`RaucaError`, and the job has failed, when the program is not there any more."""
        if self.phase == "paused":
            try:
                self._begin()
            except contract.RaucaError as error:
                self._close("failed", str(error))
                raise

    def stop(self) -> None:
        """End the job, keeping what is finished; a second call does not wait for what the child has in hand."""
        if self.phase == "paused":
            self._close("stopped", rpt(STOPPED))
        elif self.phase == "stopping":
            self._process.kill()
        elif self.alive:
            self.phase = "stopping"
            self._process.stop()

    def _begin(self) -> None:
        command = self.task.command()
        try:
            self._process = child_process.ChildProcess(command)
        except OSError as error:
            self.task.clean()
            raise contract.RaucaError(f"{command[0]}: cannot be started ({error.strerror}); choose another") from None
        self._process.listen(self._hear)
        self.phase, self.left_s = "starting", None

    def _hear(self, line: str) -> None:
        """In a thread of its own."""
        if (told := self.task.hear(line)) is not None:
            self._news.put(told)

    def _take(self, told: JobUpdate) -> None:
        if told.note and told.note not in self.notes:
            self.notes.append(told.note)
        if told.done is not None and told.total is not None:
            self.done, self.total, self.left_s, self.doing = told.done, told.total, told.left_s, told.doing
            self.phase = "running" if self.phase == "starting" else self.phase
        for step in told.figures:
            for name, value in step.items():
                self.history.setdefault(name, []).append(value)
        self.pictures.update(told.pictures)

    def _end(self, code: int) -> None:
        if code == 0:
            self._close("done", rpt("Finished"))
        elif self.phase == "pausing":
            self.phase, self.left_s = "paused", None
        elif self.phase == "stopping":
            self._close("stopped", rpt(STOPPED))
        else:
            self._close("failed", ending(code, self._process.complaints()))

    def _close(self, phase: Phase, words: str) -> None:
        self.phase, self.ending, self.left_s = phase, words, None
        self.task.clean()
