"""The estimate of the panel: frames of the dataset, and how long they take."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...estimate import Pace, Work, measure, recall, remember
from ...own_folder import own_folder

_kept: list[Pace] = []  # read once: panels are drawn often


def pace() -> Pace:
    """How fast this machine renders, as far as known."""
    if not _kept:
        _kept.append(recall(own_folder()))
    return _kept[0]


def forget() -> None:
    """Read the pace again when it is next asked for."""
    _kept.clear()


def learn(dataset: Path, workers: int) -> None:
    """Take the pace from a dataset that so many processes rendered here; too few frames change nothing.

    Raises:
        RaucaError: the folder holds no dataset, or the pace cannot be kept.
    """
    measured = measure(dataset, workers)
    if measured is None:
        return
    _kept[:] = [measured]
    remember(measured, own_folder())


def frame_count(context: bpy.types.Context) -> int:
    """Frames of the dataset that the panels describe, or of the part of it that is wanted."""
    steps = context.scene.rauca
    weathers = 1 if steps.weather.used == "ONE" else len(steps.weather.listed())
    every = len(steps.cameras.ring()) * weathers * int(steps.dataset.locations)
    return min(every, steps.dataset.part or every)


def estimated_seconds(context: bpy.types.Context) -> float:
    """Seconds that rendering them takes."""
    dataset = context.scene.rauca.dataset
    work = Work(dataset.size, dataset.samples, dataset.denoise, dataset.light)
    return pace().seconds(work, frame_count(context))
