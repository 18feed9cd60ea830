"""``rauca dataset densify``: composed frames as a data set on disk, for other tools."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from time import perf_counter

from ...contract import (
    Dataset,
    LedgerEntry,
    PlannedFrame,
    Progress,
    RaucaError,
    append_entry,
    claim_folder,
    frame_folder,
    frame_states,
    load_frame,
    save_frame,
    seal_dataset,
)
from ...contract.files import atomic_folder, read_sums
from .drawn import Views

BATCH = 32  # frames of one place that are handed to the threads at once


def densify(
    views: Views, out: Path, on_frame: Callable[[Progress], None] = lambda _: None, threads: int = 2
) -> Dataset:
    """Write every view as a frame of a data set that says it was composed; run again to go on.

    Views that see less of the paint than the plan's ``min_visible`` are kept out, as in any data set. Irradiance
    textures of the sources, which light the views, go with them.

    Raises:
        RaucaError: ``out`` holds another data set, that of the sources, or views in other light; a damaged source; a
            full disk.
    """
    out = Path(out)
    if out.resolve() == views.dataset.folder.resolve():
        raise RaucaError(f"{out}: holds the frames to compose from; choose another folder")
    claim_folder(out, replace(views.plan, name=out.name))
    if not (out / "vehicle").is_dir():
        with atomic_folder(out / "vehicle") as folder:
            shutil.copytree(views.dataset.vehicle_folder, folder, dirs_exist_ok=True)
    states = frame_states(out)
    _check_seed(views, out, states)
    _carry_light(views, out, begun="done" in states.values())
    missing = [index for index, task in enumerate(views.tasks) if states.get(task.id) not in ("done", "occluded")]
    done = len(views) - len(missing)
    for task in _written(views, _by_place(views.tasks, missing), out, threads):
        done += 1
        on_frame(Progress(done, len(views), task.id))
    seal_dataset(out)
    return Dataset(out)


def _check_seed(views: Views, out: Path, states: dict[str, str]) -> None:
    """Cameras of another seed have the same names: what is there must be of this one."""
    there = next((task for task in views.tasks if states.get(task.id) == "done"), None)
    if there is not None and load_frame(frame_folder(out, there.id)).seed != views.view(there).seed:
        raise RaucaError(f"{out}: holds views of another seed; choose another folder or remove it")


def _carry_light(views: Views, out: Path, begun: bool) -> None:
    """Copy the irradiance textures, checksums and all; views that are there must have been lit by the same."""
    ours, theirs = (_lights(folder) for folder in (views.dataset.folder, out))
    if begun and ours != theirs:
        told = f"holds views in other light than that of {views.dataset.folder} now"
        raise RaucaError(f"{out}: {told}; choose another folder or remove it")
    if begun:
        return
    shutil.rmtree(out / "irradiance", ignore_errors=True)
    if ours:
        with atomic_folder(out / "irradiance") as folder:
            for name in ours:
                shutil.copytree(views.dataset.folder / "irradiance" / name, folder / name)


def _lights(dataset: Path) -> dict[str, dict[str, str]]:
    """Digests of a data set's irradiance textures, by the name of their folder."""
    return {folder.parent.name: read_sums(folder.parent) for folder in dataset.glob("irradiance/L*/SHA256SUMS")}


def _by_place(tasks: Sequence[PlannedFrame], indices: Sequence[int]) -> list[int]:
    """So that a place's sources are read once."""
    return sorted(indices, key=lambda index: (tasks[index].place_and_weather, tasks[index].view))


def _written(views: Views, order: Sequence[int], out: Path, threads: int) -> Iterator[PlannedFrame]:
    """Frames as they are done, in order."""

    def make(index: int) -> LedgerEntry:
        began = perf_counter()
        made = views[index]
        if made.frame.visible < views.plan.min_visible:
            return LedgerEntry(made.frame.id, "occluded", visible=round(made.frame.visible, 3))
        save_frame(frame_folder(out, made.frame.id), made.frame, made.passes)
        return LedgerEntry(made.frame.id, "done", round(perf_counter() - began, 3))

    with ThreadPoolExecutor(threads, "views") as pool:
        for start in range(0, len(order), BATCH):
            some = order[start : start + BATCH]
            for index, entry in zip(some, pool.map(make, some), strict=True):
                append_entry(out, entry)
                yield views.tasks[index]
