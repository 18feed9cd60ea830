"""Blender jobs in a process of their own: torch and Blender never share memory, and a crash of one spares the other."""

from __future__ import annotations

import importlib.util
import logging
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from queue import SimpleQueue

from ..contract import Job, Progress, RaucaError, parse_progress, save_job
from ..contract.system import in_blender, killed_by
from .child_process import ChildProcess

LOG = logging.getLogger(__name__)  # without a handler of the caller's, warnings go to standard error as they are

LIBRARIES = "libx11-6 libxi6 libxrender1 libxxf86vm1 libxfixes3 libxkbcommon0 libsm6 libice6 libgl1 libegl1 libgomp1"
"""What Blender links to, as Debian's packages."""


def blender_command(job: Path, blender: Path | None = None, threads: int = 0) -> list[str]:
    """The command that does the work of a job's file: in ``blender`` if given, else in the bpy wheel.

    Args:
        threads: of Blender; 0: as many as there are cores.

    Raises:
        RaucaError: neither is there.
    """
    if blender is None:
        require_bpy("pass --blender PROGRAM")
    elif not blender.is_file():
        raise RaucaError(f"{blender}: no such program; give the path of a Blender executable")
    root = str(Path(__file__).resolve().parents[2])
    code = f"import sys; sys.path.insert(0, {root!r}); from blender_addon import headless; sys.exit(headless.main())"
    return in_blender(code, job, str(blender or ""), threads)


def require_bpy(instead: str = "") -> None:
    """Raise :class:`RaucaError` where the bpy wheel is not installed; ``instead`` is what would do without it."""
    if importlib.util.find_spec("bpy") is None:
        wheel = "`pip install rauca[dataset]` for the wheel (there is none for Python 3.12)"
        raise RaucaError(f"Blender is missing: {wheel}" + (f", or {instead}" if instead else ""))


def run_blender(job: Job, progress: Callable[[Progress], None], blender: Path | None = None) -> None:
    """Let a Blender do a job to its end.

    Args:
        progress: called at every item.

    Raises:
        RaucaError: what the job said was wrong, or how it died.
    """
    run_blenders([job], progress, blender)


def run_blenders(jobs: Sequence[Job], progress: Callable[[Progress], None], blender: Path | None = None) -> None:
    """Let a Blender each do jobs of one task at once; the first that fails ends the others.

    Args:
        progress: called at every item, with what all have done.

    Raises:
        RaucaError: what a job said was wrong, or how it died.
    """
    with tempfile.TemporaryDirectory(prefix="rauca-job-") as folder:
        paths = [Path(folder) / f"job-{number}.json" for number in range(len(jobs))]
        for path, job in zip(paths, jobs, strict=True):
            save_job(path, job)
        threads = [getattr(job, "threads", 0) for job in jobs]  # those that render have them
        commands = [blender_command(path, blender, few) for path, few in zip(paths, threads, strict=True)]
        run_commands(jobs[0].task, commands, progress)


def run_commands(task: str, commands: Sequence[Sequence[str]], progress: Callable[[Progress], None]) -> None:
    """Run commands that share a task and tell their progress; raises :class:`RaucaError` as :func:`run_blenders`."""
    lines: SimpleQueue[tuple[int, str | None]] = SimpleQueue()
    children: list[ChildProcess] = []
    told: dict[int, Progress] = {}
    try:
        for number, command in enumerate(commands):
            children.append(ChildProcess(command))
            children[-1].listen(partial(_put, lines, number), partial(_put, lines, number, None))
        running = len(children)
        while running:
            number, line = lines.get()
            if line is None:
                running -= 1
                if code := children[number].wait():
                    raise RaucaError(reason_of(task, code, children[number].complaints()))
            elif news := parse_progress(line):
                told[number] = news
                progress(_together(list(told.values()), news.last))
            elif line.startswith("note: "):
                LOG.warning(line)
    except BaseException:
        for child in children:
            child.end()
        raise


def _put(lines: SimpleQueue[tuple[int, str | None]], number: int, line: str | None) -> None:
    lines.put((number, line))


def _together(told: Sequence[Progress], last: str) -> Progress:
    """What several have done; the one that needs longest says how long it takes."""
    left = [one.left_s for one in told if one.left_s is not None]
    return Progress(sum(one.done for one in told), sum(one.total for one in told), last, max(left, default=None))


def reason_of(task: str, code: int, complaints: Sequence[str], program: str = "Blender") -> str:
    """Why a job failed: its own sentence if it left one on standard error, else how it died."""
    for line in reversed(complaints):
        for mark in ("error: ", "interrupted: "):
            if line.startswith(mark):
                return line.removeprefix("error: ").strip()
    if name := killed_by(code):
        return (
            f"{task}: {program} was killed by {name} (out of memory?); finished frames are kept, run the command again"
        )
    tail = next((line.strip() for line in reversed(complaints) if line.strip()), "no message")
    if advice := libraries_for(tail):
        return f"{task}: Blender does not start: {tail.removeprefix('ImportError: ')}; {advice}"
    return f"{task}: {program} stopped with code {code}: {tail}"


def libraries_for(complaint: str) -> str:
    """What to install where Blender complains of a library that the system lacks; empty for any other complaint."""
    return f"on Debian: apt-get install {LIBRARIES}" if "cannot open shared object file" in complaint else ""
