"""What the user sees while long work runs."""

from __future__ import annotations

import contextlib
import os
import shlex
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Task, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bar
from rich.text import Text

from rauca_core.contract import Progress, RaucaError, StoppedError, format_duration

# No markup: a path or a remedy may hold `[/b]` or `rauca[detectors]`, which rich would take for its own.
_Plain = partial(Console, markup=False, emoji=False)
console = _Plain(stderr=True)
SILENT_S = 60.0  # that a log without a terminal stays without a line at most


def output(width: int = 0) -> Console:
    """Standard output, for tables; at least ``width`` characters wide, as a log has no terminal's width."""
    return _Plain(width=max(Console().width, width))


class TimeLeft(TimeRemainingColumn):
    """The job's own estimate where it makes one."""

    def render(self, task: Task) -> Text:
        left_s = task.fields.get("left_s")
        return super().render(task) if left_s is None else Text(format_duration(left_s), style="progress.remaining")


@contextlib.contextmanager
def progress_bar(title: str, every_step: bool = False, resumes: bool = True) -> Iterator[Callable[[Progress], None]]:
    """A progress bar with an estimate of the time left; yields the function that moves it.

    Without a terminal (logs, CI) a line is printed at the start, every minute and at the end, with ``every_step`` at
    each step, too.

    Args:
        resumes: the same command goes on where this one stopped.

    Raises:
        StoppedError: in place of a KeyboardInterrupt inside.
        RaucaError: the same, where nothing is kept.
    """
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeLeft(),
        TextColumn("{task.fields[last]}", style="dim", markup=False),
    )
    with Bar(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(title, total=None, last="")
        seen: list[Progress] = []
        estimate, told_at = Estimate(), time.monotonic()

        def move(progress: Progress) -> None:
            nonlocal told_at
            bar.update(task, completed=progress.done, total=progress.total, last=progress.last, left_s=progress.left_s)
            left_s, due = estimate.left_s(progress), every_step or time.monotonic() - told_at >= SILENT_S
            if due and not console.is_terminal and progress not in seen:
                console.print(step_line(replace(progress, left_s=left_s)), highlight=False, soft_wrap=True)
                told_at = time.monotonic()
            seen[:] = [progress]

        if not console.is_terminal:
            console.print(f"{title} ...")
        try:
            yield move
        except KeyboardInterrupt:
            # Here, since typer would end the program without a word.
            if resumes:
                raise StoppedError("interrupted; what was finished is kept") from None
            raise RaucaError("interrupted; nothing was kept") from None
        if not console.is_terminal and seen:
            console.print(f"{title}: {seen[0].done} of {seen[0].total}")


class Estimate:
    """The time left of a piece of work: its own estimate, or else judged by what was done since it was first told."""

    def __init__(self) -> None:
        self._began: tuple[float, int] | None = None

    def left_s(self, progress: Progress) -> float | None:
        """Seconds, None where nothing can be said yet."""
        self._began = since, before = self._began or (time.monotonic(), progress.done)
        done = progress.done - before
        if progress.left_s is not None or done <= 0:
            return progress.left_s
        return (time.monotonic() - since) / done * (progress.total - progress.done)


def step_line(progress: Progress) -> str:
    """One step for a log."""
    left = "" if progress.left_s is None else f", about {format_duration(progress.left_s)} left"
    return f"[{progress.done}/{progress.total}] {progress.last}{left}"


@contextlib.contextmanager
def progress_bars() -> Iterator[Callable[[str, Progress], None]]:
    """A bar for each thing that a study does in turn; yields what it tells its progress.

    Raises:
        StoppedError: in place of a KeyboardInterrupt inside.
    """
    with contextlib.ExitStack() as stack:
        shown: dict[str, Callable[[Progress], None]] = {}

        def show(title: str, progress: Progress) -> None:
            if title not in shown:
                stack.pop_all().close()
                shown.clear()
                shown[title] = stack.enter_context(progress_bar(title))
            shown[title](progress)

        try:
            yield show
        except KeyboardInterrupt:
            raise StoppedError("interrupted; what was finished is kept") from None


def line_writer() -> Callable[[str], None]:
    """What writes lines on standard output, for programs; silent once nobody reads any more."""
    heard = True

    def say(line: str) -> None:
        nonlocal heard
        try:
            if heard:
                os.write(1, f"{line}\n".encode())  # one write, whole lines: nothing comes between or is left to flush
        except BrokenPipeError:
            heard = False

    return say


def progress_lines() -> Callable[[str, Progress], None]:
    """What tells a study's progress by :func:`line_writer`.

    A line's ``last`` is what is being done, ``left_s`` the time left of that alone, judged by what was done of it here.
    """
    estimates: defaultdict[str, Estimate] = defaultdict(Estimate)
    say = line_writer()

    def tell(title: str, progress: Progress) -> None:
        say(Progress(progress.done, progress.total, title, estimates[title].left_s(progress)).line())

    return tell


def command_line(short: bool = False) -> str:
    """What the user typed; ``short``: paths by their last names, as machines differ."""
    words = sys.argv[1:]
    return shlex.join(["rauca", *((Path(w).name if short and "/" in w else w) for w in words)])
