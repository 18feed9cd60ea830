"""Rendering a data set: every planned frame once, atomically, in an order that reuses what it can."""

from __future__ import annotations

import json
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..core import colour, contract, files
from .annotate import Annotation
from .light_maps import light_maps
from .session import Session

BYTES_PER_PIXEL = 24  # of a finished frame, generously

Progress = Callable[[int, int, str], None]


def render_dataset(session: Session, folder: Path, progress: Progress) -> None:
    """Render the frames of the session's plan that ``folder`` lacks.

    The plan is already in ``folder`` (:func:`contract.claim_folder`). A killed job loses the frame in flight; running
    it again continues. Frames whose paint is hidden beyond the plan's limit are kept out and noted in the ledger.

    Args:
        progress: called with (frames done, frames planned, last frame's id).
    """
    plan = session.plan
    files.sweep_partials(folder / "frames")
    finished = _finished(folder)
    todo: dict[int, dict[contract.Weather, list[tuple[str, int]]]] = defaultdict(lambda: defaultdict(list))
    for frame_id, location, view, weather in plan.frame_ids():
        if frame_id not in finished:
            todo[location][weather].append((frame_id, view))
    done, total = len(finished), len(plan.frame_ids())
    progress(done, total, "")

    for location, by_weather in todo.items():
        session.enter(location)
        views = sorted({view for jobs in by_weather.values() for _, view in jobs})
        visible = {view: session.visible(location, view) for view in views}
        seen = [view for view in views if visible[view] >= plan.min_visible]
        annotations = session.annotations(location, seen)
        for weather, jobs in by_weather.items():
            session.set_weather(weather)
            for frame_id, view in jobs:
                started = time.perf_counter()
                if view in annotations:
                    _render_frame(session, folder, frame_id, location, view, weather, annotations[view], visible[view])
                    entry = {"frame": frame_id, "state": "done", "seconds": round(time.perf_counter() - started, 3)}
                else:
                    entry = {"frame": frame_id, "state": "occluded", "visible": round(visible[view], 3)}
                files.append_line(folder / "ledger.jsonl", json.dumps(entry))
                done += 1
                progress(done, total, frame_id)


def require_space(plan: contract.Plan, folder: Path) -> None:
    """Raise :class:`RaucaError` before anything is written if the frames that ``folder`` lacks would fill the disk."""
    missing = len(plan.frame_ids()) - len(_finished(folder))
    files.require_space(folder, plan.size**2 * BYTES_PER_PIXEL * missing)


def _render_frame(
    session: Session,
    folder: Path,
    frame_id: str,
    location: int,
    view: int,
    weather: contract.Weather,
    annotation: Annotation,
    visible: float,
) -> None:
    plan, viewpoint = session.plan, session.viewpoint(location, view)
    frame = contract.Frame(
        id=frame_id,
        location=location,
        view=view,
        camera=viewpoint.camera,
        vehicle_to_world=session.place.pose(location),
        weather=weather,
        azimuth_deg=viewpoint.azimuth_deg,
        elevation_deg=viewpoint.elevation_deg,
        distance_m=viewpoint.distance_m,
        box_xyxy=annotation.box_xyxy(),
        visible=visible,
        seed=session.seed(location, view, weather),
    )
    reference = colour.linear_from_srgb(np.array(plan.reference_srgb) / 255)
    A = B = None
    if plan.light:
        A, B, image = light_maps(session, location, view, weather, annotation.paint > 0, reference)
    else:
        session.vehicle.paint.set_colour(tuple(reference.tolist()))
        image = session.render(location, view, weather)
    passes = contract.FramePasses(
        image_linear=image,
        vehicle=annotation.vehicle.astype(np.float32) / 255,
        paint=annotation.paint.astype(np.float32) / 255,
        distance=annotation.distance.astype(np.float32),
        A=A,
        B=B,
    )
    contract.save_frame(contract.frame_folder(folder, frame_id), frame, passes)


def _finished(folder: Path) -> set[str]:
    """Frames that need no work: a complete folder, or a ledger line that keeps them out."""
    frames = folder / "frames"
    finished = (
        {entry.name for entry in frames.iterdir() if (entry / "frame.json").is_file()} if frames.is_dir() else set()
    )
    ledger = folder / "ledger.jsonl"
    for line in ledger.read_text().splitlines() if ledger.is_file() else []:
        try:
            entry = json.loads(line)
        except json.JSONDecodeError:
            continue  # the line in flight when a job was killed
        if entry.get("state") == "occluded":
            finished.add(entry["frame"])
    return finished
