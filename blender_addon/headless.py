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

from .arguments import apply_parser, dataset_parser, render_parser
from .core import assets, contract, files
from .jobs.messages import News
from .scene.images import read_image_blender


def make_dataset(arguments: Sequence[str]) -> int:
    """Entry of ``pipelines/make_dataset.py``; returns the exit code."""
    return _guarded(_make_dataset, dataset_parser().parse_args(arguments))


def render_camouflages(arguments: Sequence[str]) -> int:
    """Entry of ``pipelines/render_camouflage.py``; returns the exit code."""
    return _guarded(_render_camouflages, render_parser().parse_args(arguments))


def apply_camouflage(arguments: Sequence[str]) -> int:
    """Entry of ``rauca apply``; returns the exit code."""
    return _guarded(_apply_camouflage, apply_parser().parse_args(arguments))


def main() -> int:
    """Entry of a child process: the first argument names the job."""
    jobs = {
        "make_dataset": make_dataset,
        "render_camouflages": render_camouflages,
        "apply_camouflage": apply_camouflage,
    }
    job, *arguments = blender_arguments()
    return jobs[job](arguments)


def blender_arguments() -> list[str]:
    """What follows ``--`` in Blender, everything in plain Python."""
    if "--" in sys.argv:
        return sys.argv[sys.argv.index("--") + 1 :]
    return [] if bpy.app.binary_path else sys.argv[1:]


def _make_dataset(options: argparse.Namespace) -> None:
    from .scene.dataset import render_chunk
    from .scene.session import Session

    weathers = contract.find_preset(options.weathers, assets.assets_folder() / "weathers")
    ring = contract.Ring(
        azimuths_deg=options.azimuths,
        elevations_deg=options.elevations,
        distances_m=options.distances,
        jitter_azimuth_deg=options.jitter_azimuth,
        jitter_elevation_deg=options.jitter_elevation,
        jitter_distance=options.jitter_distance,
        jitter_aim_m=options.jitter_aim,
        jitter_roll_deg=options.jitter_roll,
        fov_deg=options.fov,
    )
    vehicle = find_vehicle(options.vehicle, options.paint_mask, options.paint_material)
    plan = contract.Plan(
        name=options.out.name,
        vehicle_name=vehicle.name,
        atlas_id=vehicle.atlas_id,
        size=options.size,
        quality=contract.Quality(
            options.samples, options.adaptive_threshold, options.denoise, options.bounces, options.composed_fog
        ),
        light=options.light,
        weathers=tuple(weathers),
        ring=ring,
        locations=options.locations,
        reference_srgb=options.reference,
        min_visible=options.min_visible,
        seed=options.seed,
        blender=bpy.app.version_string,
        scenery=contract.Scenery.of_file(options.scene) if options.scene else contract.Scenery(),
        finish=options.finish,
        recolour_share=options.recolour_share,
    )
    plan.check("options")
    session = Session(plan, vehicle, options.scene)
    contract.claim_folder(options.out, plan)
    if not (options.out / "vehicle" / "vehicle.json").is_file():
        vehicle.save(options.out / "vehicle")
    for note in vehicle.notes:
        print(f"note: {note}", flush=True)
    frames = contract.planned_frames(plan)
    states = contract.frame_states(options.out)
    report = _reporter(options.json_progress)
    count = [len(states)]

    def tell(news: News) -> None:
        if news.event in ("done", "occluded"):
            contract.append_entry(options.out, contract.LedgerEntry(news.frame, news.event))
            count[0] += 1
            report(count[0], len(frames), news.frame)

    files.sweep_partials(options.out / "frames")
    for chunk in contract.chunks(plan, [f for f in frames if f.id not in states], 200):
        render_chunk(session, options.out, chunk, tell)


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
    render_camouflages(session, dataset, paintworks, options.out, _reporter(options.json_progress), options.every)


def _apply_camouflage(options: argparse.Namespace) -> None:
    from .scene.apply import save_blend

    if options.out.suffix != ".blend":
        raise contract.RaucaError(f"{options.out}: --out must end in .blend")
    save_blend(
        find_vehicle(options.vehicle, options.paint_mask, options.paint_material), options.camouflage, options.out
    )


def find_vehicle(name_or_path: str, paint_mask: Path | None, paint_material: str | None) -> contract.Vehicle:
    """A shipped vehicle by name, or any vehicle file."""
    shipped = assets.assets_folder() / "vehicles"
    known = sorted(p.parent.name for p in shipped.glob("*/vehicle.json"))
    if name_or_path in known:
        if paint_mask or paint_material:
            raise contract.RaucaError(f"--vehicle {name_or_path} brings its own paint; drop the paint option")
        return contract.load_vehicle(shipped / name_or_path, read_image_blender)
    path = Path(name_or_path)
    if not path.exists():
        raise contract.RaucaError(
            f"{path}: no such vehicle; give an .obj, .glb or .blend file, or one of {', '.join(known)}"
        )
    from .scene.vehicle_import import import_vehicle

    return import_vehicle(path, paint_mask, paint_material)


def _guarded(job: Callable[[argparse.Namespace], None], options: argparse.Namespace) -> int:
    """Run a job; a :class:`RaucaError` or an interruption becomes one line on standard error and exit code 2."""

    def interrupt(number: int, stack: FrameType | None) -> NoReturn:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, interrupt)
    try:
        with files.disk_errors(getattr(options, "out", Path())):
            job(options)
    except contract.RaucaError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        return 2
    except KeyboardInterrupt:
        print("interrupted: finished frames are kept; run the same command to go on", file=sys.stderr, flush=True)
        return 2
    return 0


def _reporter(as_json: bool) -> Callable[[int, int, str], None]:
    def report(done: int, total: int, last: str) -> None:
        if as_json:
            print(contract.Progress(done, total, last).line(), flush=True)
        else:
            print(f"[{done}/{total}] {last}", flush=True)

    return report


if __name__ == "__main__":
    sys.exit(main())
