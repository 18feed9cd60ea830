"""What runs inside Blender without a window: a job, see `rauca_core/contract/job.py`.

The same code serves ``blender -b`` and the bpy wheel. Exit codes: 0 done, 2 a mistake or an interruption told in one
line on standard error.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import NoReturn

import bpy

from . import devices
from .core import contract, files, system
from .jobs import dataset_job
from .scene.camouflages import read_paintwork, render_camouflages, save_blend
from .scene.images import read_image_blender
from .scene.session import Session
from .scene.uvs import unwrapped
from .scene.vehicle_files import find_vehicle

Report = Callable[[contract.Progress], None]


def main() -> int:
    """Entry of a process that was started for one job: the argument is its file; returns the exit code."""
    (path,) = blender_arguments()
    return run(lambda: contract.load_job(Path(path)), as_json=True)


def blender_arguments() -> list[str]:
    """What follows ``--`` in Blender, everything in plain Python."""
    if "--" in sys.argv:
        return sys.argv[sys.argv.index("--") + 1 :]
    return [] if bpy.app.binary_path else sys.argv[1:]


def run(find_job: Callable[[], contract.Job], as_json: bool) -> int:
    """Do a job; a :class:`RaucaError` or an interruption becomes one line on standard error and exit code 2.

    Args:
        find_job: reads it, and may find mistakes.
        as_json: tell progress as JSON lines, for programs.
    """

    def interrupt(number: int, stack: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    for number in system.stop_signals():  # in Blender, Ctrl-C is Blender's own until it is taken over
        signal.signal(number, interrupt)
    try:
        job = find_job()
        with files.disk_errors(job.out):
            _do(job, _report_as_json if as_json else _report_in_words)
    except contract.RaucaError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 2
    except KeyboardInterrupt:
        print("interrupted: finished frames are kept; run the same command to go on", file=sys.stderr, flush=True)
        return 2
    except BrokenPipeError:
        return 2  # who started us is gone, and nobody is left to be told
    return 0


def _do(job: contract.Job, report: Report) -> None:
    if isinstance(job, contract.MakeDataset):
        dataset_job.make(job, report)
    elif isinstance(job, contract.RenderFrames):
        dataset_job.work(job)
    elif isinstance(job, contract.RenderCamouflages):
        _render_camouflages(job, report)
    elif isinstance(job, contract.ApplyCamouflage):
        save_blend(find_vehicle(job.vehicle), job.camouflage, job.out)
    elif isinstance(job, contract.ImportVehicle):
        vehicle = find_vehicle(job.vehicle)
        for note in vehicle.notes:
            print(f"note: {note}", flush=True)
        vehicle.save(job.out)
    else:
        fresh, how = unwrapped(contract.load_vehicle(job.vehicle, read_image_blender))
        replace(fresh, notes=[how]).save(job.out)


def _render_camouflages(job: contract.RenderCamouflages, report: Report) -> None:
    dataset = contract.Dataset(job.dataset)
    paintworks = [read_paintwork(path, dataset.plan.atlas_id) for path in job.camouflages]
    names = [p.name for p in paintworks]
    if len(set(names)) != len(names):
        raise contract.RaucaError(f"two camouflages share a name ({', '.join(names)}); give each JSON its own")
    vehicle = contract.load_vehicle(dataset.vehicle_folder, read_image_blender)
    samples = dataset.plan.quality.samples if job.samples is None else job.samples
    quality = replace(dataset.plan.quality, samples=samples, denoise=job.denoise)
    session = Session(replace(dataset.plan, quality=quality), vehicle, job.scene)
    devices.use(session.scene, job.device, job.threads)
    frames = [frame for frame in dataset.frames() if job.frames is None or frame.id in job.frames]
    render_camouflages(session, dataset, paintworks, job.out, lambda *news: report(contract.Progress(*news)), frames)


def _report_as_json(progress: contract.Progress) -> None:
    print(progress.line(), flush=True)


def _report_in_words(progress: contract.Progress) -> None:
    left = "" if progress.left_s is None else f", about {contract.format_duration(progress.left_s)} left"
    print(f"[{progress.done}/{progress.total}] {progress.last}{left}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
