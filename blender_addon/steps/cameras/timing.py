"""How many frames a dataset has, and how long they will take, from how long the last ones took on this machine."""

from __future__ import annotations

import statistics
from dataclasses import asdict, dataclass
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
class Pace:
    """How fast this machine is.

    Attributes:
        factor: of the model's seconds, the whole machine at one frame.
        frames: that it was measured on; 0 for a guess.
    """

    factor: float = 1.0
    frames: int = 0


_kept: list[Pace] = []  # read once: panels are drawn often


def pace() -> Pace:
    """How fast this machine renders, as far as known."""
    if not _kept:
        _kept.append(recall(own_folder()))
    return _kept[0]


def recall(folder: Path) -> Pace:
    """The pace that was kept in the extension's own folder; the guess if there is none or it cannot be read."""
    try:
        kept = schema.read_json(folder / FILE)
        found = Pace(kept.number("factor"), kept.integer("frames"))
    except contract.RaucaError:
        return Pace()
    return found if found.factor > 0.0 else Pace()


def learn(dataset: Path, workers: int) -> None:
    """Take and keep the pace of a dataset that was rendered here, from its ledger; too few frames change nothing.

    Args:
        workers: Blender processes that rendered it at once. They share the cores, so each frame took longer.

    Raises:
        RaucaError: the folder holds no dataset, or the pace cannot be kept.
    """
    plan = contract.read_plan(dataset)
    times = [entry.seconds for entry in contract.read_ledger(dataset).values() if entry.seconds]
    if len(times) >= FEWEST:
        modelled = _model_seconds(plan.size, plan.quality.samples, plan.quality.denoise, plan.light)
        _kept[:] = [Pace(statistics.median(times) / min(workers, len(times)) / modelled, len(times))]
        files.write_json(own_folder() / FILE, asdict(_kept[0]))


def frame_count(context: bpy.types.Context) -> int:
    """Frames of the dataset that the panels describe, or of the part of it that is wanted."""
    steps = context.scene.rauca
    weathers = 1 if steps.weather.used == "ONE" else len(steps.weather.listed())
    every = len(steps.cameras.ring()) * weathers * int(steps.dataset.locations)
    return min(every, steps.dataset.part or every)


def estimated_seconds(context: bpy.types.Context) -> float:
    """Seconds that rendering them takes."""
    dataset = context.scene.rauca.dataset
    modelled = _model_seconds(dataset.size, dataset.samples, dataset.denoise, dataset.light)
    return pace().factor * modelled * frame_count(context)


def frame_seconds(size: int, samples: int = 8, light: bool = False) -> float:
    """Seconds of one denoised frame here; the samples are those of held-out views."""
    return pace().factor * _model_seconds(size, samples, True, light)


def _model_seconds(size: int, samples: int, denoise: bool, light: bool) -> float:
    """Seconds of a frame on the machine that the constants were measured on."""
    per_pixel = (PER_SAMPLE * samples + DENOISING * denoise) * (size / 640.0) ** 2
    return REST + per_pixel * (LIGHT if light else 1.0)
