"""How many frames a dataset has, and how long they will take, from how long the last ones took on this machine."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from pathlib import Path

import bpy

from ...core import contract, files, schema
from ...folders import own_folder

# Seconds of one frame on two slow cores at 640 pixels a side (measured): per sample, for denoising, and for the rest
# whatever the size. Light maps are two renders of the part of the picture that shows the vehicle.
PER_SAMPLE, DENOISING, REST, LIGHT = 0.75, 4.0, 0.5, 1.4
FEWEST = 4  # frames that make a measurement
FILE = "pace.json"


@dataclass(frozen=True)
class Work:
    """What a frame's time depends on."""

    size: int
    samples: int
    denoise: bool
    light: bool

    def model_seconds(self) -> float:
        """Seconds of a frame on the machine that the constants were measured on."""
        per_pixel = (PER_SAMPLE * self.samples + DENOISING * self.denoise) * (self.size / 640.0) ** 2
        return REST + per_pixel * (LIGHT if self.light else 1.0)


@dataclass(frozen=True)
class Pace:
    """How fast this machine is.

    Attributes:
        factor: of the model's seconds, the whole machine at one frame.
        frames: that it was measured on; 0 for a guess.
    """

    factor: float = 1.0
    frames: int = 0

    def seconds(self, work: Work, frames: int) -> float:
        """Seconds that so many frames take."""
        return self.factor * work.model_seconds() * frames


def measure(dataset: Path, workers: int) -> Pace | None:
    """The pace of a dataset that was rendered here, from its ledger; None when it has too few timed frames.

    Args:
        workers: Blender processes that rendered it at once. They share the cores, so each frame took longer.

    Raises:
        RaucaError: the folder holds no dataset that can be read.
    """
    plan = contract.read_plan(dataset)
    times = [entry.seconds for entry in contract.read_ledger(dataset).values() if entry.seconds]
    if len(times) < FEWEST:
        return None
    work = Work(plan.size, plan.quality.samples, plan.quality.denoise, plan.light)
    at_once = min(workers, len(times))
    return Pace(statistics.median(times) / at_once / work.model_seconds(), len(times))


def remember(pace: Pace, folder: Path) -> None:
    """Keep a pace in the extension's own folder."""
    files.write_json(folder / FILE, {"factor": pace.factor, "frames": pace.frames})


def recall(folder: Path) -> Pace:
    """The pace that was kept; the guess if there is none or it cannot be read."""
    try:
        kept = schema.read_json(folder / FILE)
        pace = Pace(kept.number("factor"), kept.integer("frames"))
    except contract.RaucaError:
        return Pace()
    return pace if pace.factor > 0.0 else Pace()


_kept: list[Pace] = []  # read once: panels are drawn often


def pace() -> Pace:
    """How fast this machine renders, as far as known."""
    if not _kept:
        _kept.append(recall(own_folder()))
    return _kept[0]


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
