"""The options of the jobs that run in Blender, and the job that they describe.

Here are the standard library and the contract only: the same options serve ``rauca`` and programs run inside Blender.
"""

from __future__ import annotations

import argparse
from collections.abc import Collection
from pathlib import Path
from typing import Any

from rauca_core.contract import (
    MIN_VISIBLE,
    REFERENCE_SRGB,
    Plan,
    Quality,
    RaucaError,
    Ring,
    Shard,
    balanced_frames,
    find_preset,
    preset_notes,
)
from rauca_core.contract.clips import MANOEUVRES, clips_asked
from rauca_core.contract.job import (
    DEVICES,
    RECYCLE,
    MakeDataset,
    VehicleSource,
    require_planned,
)
from rauca_core.contract.schema import read_json


def dataset_job(options: argparse.Namespace) -> MakeDataset:
    """What :func:`dataset_parser`'s options ask for; raises :class:`RaucaError` for a mistake in them."""
    vehicle = VehicleSource(options.vehicle or "sedan", options.paint_mask, options.paint_material)
    if options.plan:
        plan = _plan_of_file(options)
        beside = options.plan.parent / "vehicle"
        if not options.vehicle and beside.is_dir():
            vehicle = VehicleSource(str(beside), options.paint_mask, options.paint_material)
    else:
        plan = _plan_of(options)
    plan.check("options")
    return MakeDataset(
        out=options.out,
        plan=plan,
        vehicle=vehicle,
        scene=options.scene,
        frames=_frames(options, plan),
        shard=options.shard,
        workers=options.workers,
        recycle=options.recycle,
        retry_quarantined=options.retry_quarantined,
        device=options.render_device,
        notes=() if options.plan else tuple(preset_notes(options.weathers)),
    )


def _plan_of(options: argparse.Namespace) -> Plan:
    """The plan that the options spell out; the vehicle's part of it is known in Blender."""
    ring = Ring(
        options.azimuths, options.elevations, options.distances, options.jitter_azimuth, options.jitter_elevation,
        options.jitter_distance, options.jitter_aim, options.jitter_roll, options.fov,
    )  # fmt: skip
    quality = Quality(
        options.samples, options.adaptive_threshold, options.denoise, options.bounces, options.composed_fog
    )
    same = ("size", "light", "locations", "min_visible", "seed", "finish", "recolor_share")
    chosen = {name: getattr(options, name) for name in same} | _driven(options)
    return Plan.of(find_preset(options.weathers), ring, quality=quality, reference_srgb=options.reference, **chosen)


def _driven(options: argparse.Namespace) -> dict[str, Any]:
    """What clips change in a plan: they keep frames in which the vehicle is hidden, as a tracker sees those too."""
    if not options.clips:
        return {}
    driven = (options.clip_frames, options.speed, options.frame_rate, options.shutter, options.readout)
    return {"clips": clips_asked(options.clips, *driven), "min_visible": 0.0}


def _plan_of_file(options: argparse.Namespace) -> Plan:
    """The plan that lies in a file, without what was noted of the Blender that rendered it."""
    if said := _typed(options, plan_parser()):
        raise RaucaError(f"--{said}: {options.plan} says it; leave one of the two out")
    return Plan.from_json(read_json(options.plan))


def _typed(options: argparse.Namespace, parser: argparse.ArgumentParser) -> str | None:
    """The first option of a parser that is not as it is when left out; None if there is none."""
    usual = vars(parser.parse_args([]))
    return next((name.replace("_", "-") for name in usual if getattr(options, name) != usual[name]), None)


def refuse_without_slurm(options: argparse.Namespace) -> None:
    """Raise :class:`RaucaError` when options ask something of a cluster, and none is to be used."""
    if not options.slurm and (said := _typed(options, slurm_parser())):
        raise RaucaError(f"--{said}: is of a Slurm cluster; give --slurm too, or leave it out")


def _frames(options: argparse.Namespace, plan: Plan) -> tuple[str, ...] | None:
    """Ids of the frames that ``--only`` or ``--frames`` choose; None without."""
    if options.frames:
        return tuple(balanced_frames(plan, options.frames))
    return tuple(sorted(_named_frames(options.only, plan))) if options.only else None


def _named_frames(path: Path, plan: Plan) -> Collection[str]:
    """The frame ids listed in ``path``, one per line.

    Raises:
        RaucaError: the file cannot be read, names no frame, or one that is not planned.
    """
    try:
        named = frozenset(path.read_text(encoding="utf-8").split())
    except (OSError, UnicodeDecodeError) as error:
        raise RaucaError(f"{path}: cannot be read ({error}); give a text file of frame ids") from None
    require_planned(named, plan, str(path))
    return named


def dataset_parser() -> argparse.ArgumentParser:
    """Arguments of ``make_dataset``."""
    parser = argparse.ArgumentParser(
        prog="make_dataset.py", description="Render a multi-weather data set of a vehicle.", allow_abbrev=False,
        parents=[plan_parser()],
    )  # fmt: skip
    add = parser.add_argument
    add("--out", type=Path, required=True, help="folder of the data set; run again to go on after an interruption")
    add(
        "--vehicle", help="name of a shipped vehicle, a vehicle folder, or an .obj, .glb, .blend file; sedan by default"
    )
    add("--paint-mask", type=Path, help="grey PNG, white where the camouflage may go")
    add("--paint-material", help="name of the material to camouflage")
    add("--plan", type=Path, help="dataset.json of another data set, which says all that is not about this machine")
    add(
        "--scene", type=Path, help="a .blend of yours instead of the town; empties named 'rauca ...' mark the locations"
    )
    part = parser.add_mutually_exclusive_group().add_argument
    part("--only", type=Path, help="a text file with a frame id per line; the plan's other frames are left for later")
    part("--frames", type=_whole, help="a balanced part of so many frames; more of them later go on from it")
    add("--workers", type=_whole, default=1, help="Blender processes at once; they share the cores")
    add("--recycle", type=_whole, default=RECYCLE, help="frames after which a worker is replaced by a fresh one")
    add("--render-device", choices=DEVICES, default="cpu", help="that Cycles renders on; auto: a GPU if there is one")
    add("--shard", type=_shard, default=Shard(), help="i/n: only part i, counted from 1, of n that cover the data set")
    add("--retry-quarantined", action="store_true", help="try frames again that failed twice")
    add("--json-progress", action="store_true", help="progress as JSON lines, for programs")
    return parser


def plan_parser() -> argparse.ArgumentParser:
    """What a plan says: with ``--plan``, these are left out."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    add = parser.add_argument_group("the plan").add_argument
    add("--weathers", default="demo", help="preset name or .json file")
    add("--locations", type=_whole, default=1, help="places in the town; each stands in another district")
    add("--azimuths", type=_azimuths, default=_azimuths("8"), help="a count, or degrees: 0,45,90")
    add("--elevations", type=_numbers, default=(10.0, 25.0), help="degrees, comma separated")
    add("--distances", type=_numbers, default=(6.0, 10.0), help="metres, comma separated")
    add("--jitter-azimuth", type=float, default=0.0, help="half-width, degrees")
    add("--jitter-elevation", type=float, default=0.0, help="half-width, degrees")
    add("--jitter-distance", type=float, default=0.0, help="half-width, fraction of the distance")
    add("--jitter-aim", type=float, default=0.0, help="half-width, metres")
    add("--jitter-roll", type=float, default=0.0, help="half-width, degrees")
    add("--clips", default="", help=f"drive instead of standing still: all, or of {', '.join(MANOEUVRES)}")
    add("--clip-frames", type=_whole, default=30, help="frames of each clip")
    add("--speed", type=float, default=10.0, help="of the camera in clips, m/s")
    add("--frame-rate", type=float, default=15.0, help="of clips, frames a second")
    add("--shutter", type=float, default=0.0, help="seconds that it is open in clips: motion blur; 0: none")
    rolling = "seconds from the first row's exposure to the last's in clips: rolling shutter; 0: none"
    add("--readout", type=float, default=0.0, help=rolling)
    add("--fov", type=float, default=60.0, help="horizontal field of view, degrees")
    add("--size", type=_whole, default=320, help="frames are square, pixels")
    add("--samples", type=_whole, default=8, help="Cycles samples per pixel before denoising")
    add("--adaptive-threshold", type=float, default=0.0, help="stop sampling pixels at this noise; 0: never")
    add("--bounces", type=int, default=4, help="of light between surfaces")
    add("--composed-fog", action=argparse.BooleanOptionalAction, default=True, help="compose fog where accurate")
    add("--light", action=argparse.BooleanOptionalAction, default=True, help="render light maps A and B")
    add("--denoise", action=argparse.BooleanOptionalAction, default=True, help="use Open Image Denoise")
    add("--finish", default="own", help="of the paint: own, car_paint (clearcoat) or sticker (matte)")
    add("--recolor-share", type=float, default=0.0, help="share of frames also rendered for real in another color")
    add("--reference", type=_color, default=REFERENCE_SRGB, help="reference paint, sRGB like 8c8c8c")
    add("--min-visible", type=float, default=MIN_VISIBLE, help="keep out frames that see less of the paint than this")
    add("--seed", type=int, default=0)
    return parser


def slurm_parser() -> argparse.ArgumentParser:
    """The options of ``rauca dataset make`` that concern a cluster."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    add = parser.add_argument_group("on a Slurm cluster").add_argument
    add("--slurm", action="store_true", help="submit the work as a job array instead of doing it here")
    add("--shards", type=int, default=1, help="tasks that the data set is split into")
    add("--partition", help="of the cluster; its default if left out")
    add("--time", type=int, default=24 * 60, help="limit of a task, minutes")
    add("--memory", type=float, default=8.0, help="of a task, GB")
    add("--cpus", type=int, default=8, help="of a task")
    add("--no-wait", action="store_true", help="return once submitted")
    return parser


def _whole(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def _shard(text: str) -> Shard:
    try:
        return Shard.parse(text)
    except RaucaError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a comma separated list of numbers") from None


def _azimuths(text: str) -> tuple[float, ...]:
    if text.isdigit() and int(text) > 0:
        return tuple(i * 360.0 / int(text) for i in range(int(text)))
    return _numbers(text)


def _color(text: str) -> tuple[int, int, int]:
    digits = text.removeprefix("#")
    try:
        red, green, blue = bytes.fromhex(digits)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not an sRGB color like 8c8c8c") from None
    return red, green, blue
