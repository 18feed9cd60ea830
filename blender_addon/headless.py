"""The command lines that run inside Blender: make a data set, render camouflages on its views.

The same code serves ``blender -b -P pipelines/make_dataset.py -- ARGS`` and ``python pipelines/make_dataset.py ARGS``
(bpy wheel). Exit codes: 0 done, 2 a mistake or an interruption told in one line.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import NoReturn

import bpy

from .arguments import add_vehicle, apply_parser, dataset_parser, render_parser, worker_parser
from .core import contract, files
from .jobs.pace import spoken
from .scene.images import read_image_blender
from .selection import named_frames
from .vehicles import find_vehicle


def make_dataset(arguments: Sequence[str]) -> int:
    """Entry of ``pipelines/make_dataset.py``; returns the exit code."""
    return _guarded(_make_dataset, dataset_parser().parse_args(arguments))


def render_camouflages(arguments: Sequence[str]) -> int:
    """Entry of ``pipelines/render_camouflage.py``; returns the exit code."""
    return _guarded(_render_camouflages, render_parser().parse_args(arguments))


def apply_camouflage(arguments: Sequence[str]) -> int:
    """Entry of ``rauca apply``; returns the exit code."""
    return _guarded(_apply_camouflage, apply_parser().parse_args(arguments))


def work_on_dataset(arguments: Sequence[str]) -> int:
    """Entry of a worker that :func:`make_dataset` starts; returns the exit code."""
    return _guarded(_work_on_dataset, worker_parser().parse_args(arguments))


def import_vehicle(arguments: Sequence[str]) -> int:
    """Entry of the engine's own import: any vehicle file becomes a vehicle folder; returns the exit code."""
    parser = argparse.ArgumentParser(prog="import_vehicle", allow_abbrev=False)
    add_vehicle(parser.add_argument)
    parser.add_argument("--out", type=Path, required=True)
    return _guarded(_import_vehicle, parser.parse_args(arguments))


def unwrap_vehicle(arguments: Sequence[str]) -> int:
    """Entry of the process that the unwrap button starts: a vehicle folder in, one out; returns the exit code."""
    parser = argparse.ArgumentParser(prog="unwrap_vehicle", allow_abbrev=False)
    parser.add_argument("vehicle", type=Path)
    parser.add_argument("out", type=Path)
    return _guarded(_unwrap_vehicle, parser.parse_args(arguments))


def main() -> int:
    """Entry of a child process: the first argument names the job."""
    jobs = {
        "make_dataset": make_dataset,
        "dataset_worker": work_on_dataset,
        "render_camouflages": render_camouflages,
        "apply_camouflage": apply_camouflage,
        "import_vehicle": import_vehicle,
        "unwrap_vehicle": unwrap_vehicle,
    }
    job, *arguments = blender_arguments()
    return jobs[job](arguments)


def blender_arguments() -> list[str]:
    """What follows ``--`` in Blender, everything in plain Python."""
    if "--" in sys.argv:
        return sys.argv[sys.argv.index("--") + 1 :]
    return [] if bpy.app.binary_path else sys.argv[1:]


def _make_dataset(options: argparse.Namespace) -> None:
    from .dataset_job import make

    make(options, _reporter(options.json_progress))


def _work_on_dataset(options: argparse.Namespace) -> None:
    from .dataset_job import work

    work(options)


def _render_camouflages(options: argparse.Namespace) -> None:
    from .scene.camouflages import read_paintwork, render_camouflages
    from .scene.session import Session

    dataset = contract.Dataset(options.dataset)
    paintworks = [read_paintwork(path, dataset.plan.atlas_id) for path in options.camouflages]
    names = [p.name for p in paintworks]
    if len(set(names)) != len(names):
        raise contract.RaucaError(f"two camouflages share a name ({', '.join(names)}); give each JSON its own")
    vehicle = contract.load_vehicle(dataset.vehicle_folder, read_image_blender)
    samples = dataset.plan.quality.samples if options.samples is None else options.samples
    quality = replace(dataset.plan.quality, samples=samples, denoise=options.denoise)
    session = Session(replace(dataset.plan, quality=quality), vehicle, options.scene)
    report = _reporter(options.json_progress)

    def progress(done: int, total: int, last: str) -> None:
        report(contract.Progress(done, total, last))

    frames = dataset.frames()[:: options.every]
    if options.only:
        named = named_frames(options.only, {frame_id for frame_id, *_ in dataset.plan.frame_ids()})
        frames = [frame for frame in frames if frame.id in named]
    render_camouflages(session, dataset, paintworks, options.out, progress, frames)


def _apply_camouflage(options: argparse.Namespace) -> None:
    from .scene.apply import save_blend

    if options.out.suffix != ".blend":
        raise contract.RaucaError(f"{options.out}: --out must end in .blend")
    save_blend(
        find_vehicle(options.vehicle, options.paint_mask, options.paint_material), options.camouflage, options.out
    )


def _import_vehicle(options: argparse.Namespace) -> None:
    vehicle = find_vehicle(options.vehicle, options.paint_mask, options.paint_material)
    for note in vehicle.notes:
        print(f"note: {note}", flush=True)
    vehicle.save(options.out)


def _unwrap_vehicle(options: argparse.Namespace) -> None:
    from .scene.vehicle_reading import unwrapped

    fresh, how = unwrapped(contract.load_vehicle(options.vehicle, read_image_blender))
    replace(fresh, notes=[how]).save(options.out)


def _guarded(job: Callable[[argparse.Namespace], None], options: argparse.Namespace) -> int:
    """Run a job; a :class:`RaucaError` or an interruption becomes one line on standard error and exit code 2."""

    def interrupt(number: int, stack: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    for number in (signal.SIGINT, signal.SIGTERM):  # in Blender, Ctrl-C is Blender's own until it is taken over
        signal.signal(number, interrupt)
    try:
        with files.disk_errors(getattr(options, "out", Path())):
            job(options)
    except contract.RaucaError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 2
    except KeyboardInterrupt:
        print("interrupted: finished frames are kept; run the same command to go on", file=sys.stderr, flush=True)
        return 2
    except BrokenPipeError:
        return 2  # who started us is gone, and nobody is left to be told
    return 0


def _reporter(as_json: bool) -> Callable[[contract.Progress], None]:
    def report(progress: contract.Progress) -> None:
        if as_json:
            print(progress.line(), flush=True)
        else:
            left = "" if progress.left_s is None else f", about {spoken(progress.left_s)} left"
            print(f"[{progress.done}/{progress.total}] {progress.last}{left}", flush=True)

    return report


if __name__ == "__main__":
    sys.exit(main())
