"""Rendering pieces of a data set, in an order that reuses what it can."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from ..core import contract
from ..jobs.worker import News
from .frame import render_frame
from .session import Session

Tell = Callable[[News], None]


def render_chunk(
    session: Session,
    folder: Path,
    chunk: Sequence[contract.PlannedFrame],
    tell: Tell,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Render frames of one location into the data set ``folder``.

    All coverage comes first: Cycles draws other noise before the first coverage render of a process than after it, and
    a frame's bytes must not depend on what was rendered before. A frame whose paint is hidden beyond the plan's limit
    is told ``occluded``; one at which Python raises is told ``failed``, and the others go on.

    Args:
        chunk: frames of one location, as :func:`contract.chunks` gives them.
        tell: is told what happens.
        stopped: asked before each camera's coverage and each frame; True ends the work there.

    Raises:
        RaucaError: what only the user can mend: no space, no permission.
    """
    tell(News("begin", chunk[0].id))
    session.enter(chunk[0].location)
    annotations = session.annotations(chunk[0].location, _announced(chunk, tell, stopped))
    weather = None
    for task in chunk:
        if stopped():
            return
        annotation = annotations[task.view]
        if annotation.visible < session.plan.min_visible:
            tell(News("occluded", task.id, visible=round(annotation.visible, 3)))
            continue
        tell(News("begin", task.id))
        started = time.perf_counter()
        try:
            if task.weather != weather:
                weather = None  # until it is set: an exception on the way leaves the scene between two
                session.set_weather(task.weather)
                weather = task.weather
            render_frame(session, folder, task, annotation)
        except contract.RaucaError:
            raise
        except Exception as error:
            traceback.print_exc()
            tell(News("failed", task.id, reason=_one_line(error)))
        else:
            tell(News("done", task.id, seconds=round(time.perf_counter() - started, 3)))


def _announced(chunk: Sequence[contract.PlannedFrame], tell: Tell, stopped: Callable[[], bool]) -> Iterator[int]:
    """The views to look at; each is told as its first frame's begin, so that a crash there has a name."""
    first: dict[int, str] = {}
    for task in chunk:
        first.setdefault(task.view, task.id)
    for view, frame_id in sorted(first.items()):
        if stopped():
            return
        tell(News("begin", frame_id))
        yield view


def _one_line(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
