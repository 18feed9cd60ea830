"""The arguments of the headless jobs; no Blender here, so that a command line can check them before starting one."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from .core import contract

WHOLE = contract.Shard()


def dataset_parser() -> argparse.ArgumentParser:
    """Arguments of ``make_dataset``."""
    parser = argparse.ArgumentParser(
        prog="make_dataset.py", description="Render a multi-weather data set of a vehicle.", allow_abbrev=False
    )
    add = parser.add_argument
    add("--out", type=Path, required=True, help="folder of the data set; run again to go on after an interruption")
    add_vehicle(add)
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
    add("--fov", type=float, default=60.0, help="horizontal field of view, degrees")
    add("--size", type=_whole, default=320, help="frames are square, pixels")
    add("--samples", type=_whole, default=8, help="Cycles samples per pixel before denoising")
    add("--adaptive-threshold", type=float, default=0.0, help="stop sampling pixels at this noise; 0: never")
    add("--bounces", type=int, default=4, help="of light between surfaces")
    add("--composed-fog", action=argparse.BooleanOptionalAction, default=True, help="compose fog where accurate")
    add("--light", action=argparse.BooleanOptionalAction, default=True, help="render light maps A and B")
    add("--denoise", action=argparse.BooleanOptionalAction, default=True, help="use Open Image Denoise")
    _add_scene(add)
    add("--finish", default="own", help="of the paint: own, car_paint (clearcoat) or sticker (matte)")
    add("--recolor-share", type=float, default=0.0, help="share of frames also rendered for real in another color")
    add("--reference", type=_color, default=(140, 140, 140), help="reference paint, sRGB like 8c8c8c")
    add("--min-visible", type=float, default=0.5, help="keep out frames that see less of the paint than this")
    add("--seed", type=int, default=0)
    part = parser.add_mutually_exclusive_group().add_argument
    _add_only(part)
    part("--frames", type=_whole, help="a balanced part of so many frames; more of them later go on from it")
    _add_crew(add)
    add("--json-progress", action="store_true", help="progress as JSON lines, for programs")
    return parser


def worker_parser() -> argparse.ArgumentParser:
    """Arguments of the workers that ``make_dataset`` starts."""
    parser = argparse.ArgumentParser(prog="dataset_worker", allow_abbrev=False)
    add = parser.add_argument
    add("--plan", type=Path, required=True, help="folder with dataset.json and vehicle/")
    add("--out", type=Path, required=True, help="folder that frames are written to")
    add("--threads", type=int, default=0, help="0: as many as there are cores")
    _add_scene(add)
    return parser


def render_parser() -> argparse.ArgumentParser:
    """Arguments of ``render_camouflages``."""
    parser = argparse.ArgumentParser(
        prog="render_camouflage.py", description="Render a data set's views in camouflage.", allow_abbrev=False
    )
    add = parser.add_argument
    add("--dataset", type=Path, required=True, help="data set whose views are rendered")
    add("--out", type=Path, required=True, help="images go to OUT/<camouflage>/<frame>.png")
    add("--every", type=_whole, default=1, help="render only every n-th frame")
    _add_only(add)
    add("--samples", type=_whole, help="Cycles samples per pixel; the data set's own by default")
    add("--denoise", action=argparse.BooleanOptionalAction, default=True, help="use Open Image Denoise")
    _add_scene(add)
    add("--json-progress", action="store_true", help="progress as JSON lines, for programs")
    add("camouflages", type=Path, nargs="+", help="camouflage .json files")
    return parser


def apply_parser() -> argparse.ArgumentParser:
    """Arguments of ``apply_camouflage``."""
    parser = argparse.ArgumentParser(
        prog="rauca apply", description="Save a vehicle in camouflage.", allow_abbrev=False
    )
    add = parser.add_argument
    add("--out", type=Path, required=True, help="the .blend to write")
    add_vehicle(add)
    add("camouflage", type=Path, help="camouflage .json file")
    return parser


def add_vehicle(add: Callable[..., object]) -> None:
    add("--vehicle", default="sedan", help="name of a shipped vehicle, a vehicle folder, or an .obj, .glb, .blend file")
    add("--paint-mask", type=Path, help="grey PNG, white where the camouflage may go")
    add("--paint-material", help="name of the material to camouflage")


def _add_crew(add: Callable[..., object]) -> None:
    add("--workers", type=_whole, default=1, help="Blender processes at once; they share the cores")
    add("--recycle", type=_whole, default=200, help="frames after which a worker is replaced by a fresh one")
    add("--shard", type=_shard, default=WHOLE, help="i/n: only part i, counted from 1, of n that cover the data set")
    add("--retry-quarantined", action="store_true", help="try frames again that failed twice")


def _add_only(add: Callable[..., object]) -> None:
    add("--only", type=Path, help="a text file with a frame id per line; the plan's other frames are left for later")


def _add_scene(add: Callable[..., object]) -> None:
    add(
        "--scene", type=Path, help="a .blend of yours instead of the town; empties named 'rauca ...' mark the locations"
    )


def _whole(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def _shard(text: str) -> contract.Shard:
    try:
        return contract.Shard.parse(text)
    except contract.RaucaError as error:
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
