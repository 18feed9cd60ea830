"""A vehicle in camouflage: rendering a data set's views again, the judge of every camouflage, or carrying it away."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import color, contract, files, reading, schema
from .frame import expose, rain_before
from .images import read_image_blender
from .render import Crop
from .session import Session
from .vehicle import SceneVehicle

Progress = Callable[[int, int, str], None]
MARGIN = 0.1  # of a frame's side, around the vehicle: farther out no light from the paint is seen


@dataclass(frozen=True, eq=False)
class Paintwork:
    """A camouflage ready to paint: its name in folders, UV map (H, W, 3) 8-bit sRGB, and the map's hash."""

    name: str
    uv_map_srgb: NDArray[np.uint8]
    digest: str


def read_paintwork(path: Path, atlas_id: str) -> Paintwork:
    """Read a camouflage for the vehicle with ``atlas_id``; raises :class:`RaucaError` when it does not fit."""
    camouflage, image = contract.load_camouflage(path)
    camouflage.check_fits(atlas_id, str(path))
    pixels = read_image_blender(image)
    if pixels.shape != (camouflage.size, camouflage.size, 3):
        raise contract.RaucaError(
            f"{image}: is {pixels.shape[1]}x{pixels.shape[0]}, {path.name} says {camouflage.size}x{camouflage.size} "
            "RGB; keep the two files together"
        )
    return Paintwork(camouflage.name, pixels, hashlib.sha256(pixels.tobytes()).hexdigest()[:16])


def render_camouflages(
    session: Session,
    dataset: contract.Dataset,
    paintworks: list[Paintwork],
    out: Path,
    progress: Progress,
    frames: Sequence[contract.Frame] | None = None,
) -> None:
    """Render frames of ``dataset`` in every camouflage to ``out/<name>/<frame id>.png`` (8-bit sRGB).

    Only the vehicle and what is near it is rendered, some 30 % of a full frame's work; the rest is the data set's own
    image, which has the same noise. A session of another quality renders whole frames. Frames already there are kept
    if they come from the same plan, UV map and sample count, and are rendered again otherwise. Every paint of a frame
    is rendered before the next frame, as moving the vehicle to another place costs as much as a frame.
    """
    frames = dataset.frames() if frames is None else frames
    for paintwork in paintworks:
        _claim(out / paintwork.name, paintwork, session.plan)
    wanted = [(frame, paintwork) for frame in frames for paintwork in paintworks]
    missing = [(f, p) for f, p in wanted if not (out / p.name / f"{f.id}.png").is_file()]
    files.require_space(out, len(missing) * dataset.plan.size**2 * 4)
    there = len(wanted) - len(missing)
    progress(there, len(wanted), out.name)
    for done, (frame, paintwork) in enumerate(missing, there + 1):
        session.vehicle.paint.set_map(paintwork.uv_map_srgb)
        session.enter(frame.location)
        session.set_weather(frame.weather)
        pixels = _in_paint(session, dataset, frame)
        files.write_bytes(out / paintwork.name / f"{frame.id}.png", files.png_bytes(pixels))
        progress(done, len(wanted), f"{paintwork.name}/{frame.id}")


def _in_paint(session: Session, dataset: contract.Dataset, frame: contract.Frame) -> NDArray[np.uint8]:
    """The data set's image of ``frame`` with the vehicle in its present paint, (H, W, 3) 8-bit sRGB."""
    folder = dataset.frame_folder(frame.id)
    pixels = read_image_blender(folder / "image.png")
    crop = Crop.around(read_image_blender(folder / "vehicle.png") > 0, round(MARGIN * dataset.plan.size))
    if session.plan.quality != dataset.plan.quality:
        crop = Crop(0, 0, dataset.plan.size, dataset.plan.size)
    if crop is None:
        return pixels
    linear = expose(session.render(frame.location, frame.view, frame.weather, crop), frame.exposure_stops)
    distance = contract.load_passes(folder, ("distance",))["distance"]
    rain = rain_before(session, frame.location, frame.view, frame.weather, distance)
    if rain is not None:
        linear = contract.rain.over(linear, replace(rain, alpha=rain.alpha[crop.inside]))
    pixels[crop.inside] = color.to_bytes(color.linear_to_srgb(linear))
    return pixels


def _claim(folder: Path, paintwork: Paintwork, plan: contract.Plan) -> None:
    """Bind ``folder`` to a plan and a UV map; renders of others are removed, they would be mistaken for these."""
    note = folder / "camouflage.json"
    views = json.dumps(replace(plan, blender="").to_json(), sort_keys=True)
    bound = {
        "name": paintwork.name,
        "uv_map": paintwork.digest,
        "samples": plan.quality.samples,
        "margin": MARGIN,
        "plan": hashlib.sha256(views.encode()).hexdigest()[:16],
    }
    with contextlib.suppress(contract.RaucaError):  # a folder that says nothing, or in a damaged file
        if reading.parse_json(reading.read_text(note, schema.MAX_JSON_BYTES), note.name) == bound:
            return
    for stale in folder.glob("*.png"):
        stale.unlink()
    files.write_json(note, bound)


def save_blend(vehicle: contract.Vehicle, camouflage: Path, out: Path) -> None:
    """Write a .blend of nothing but the vehicle in a camouflage (.json), images packed; raises as read_paintwork."""
    paintwork = read_paintwork(camouflage, vehicle.atlas_id)
    scene = bpy.data.scenes.new("rauca")
    placed = SceneVehicle(scene, vehicle)
    placed.paint.set_map(paintwork.uv_map_srgb)
    placed.paint.pack()
    placed.object.name = f"{vehicle.name} {paintwork.name}"
    out.parent.mkdir(parents=True, exist_ok=True)
    bpy.data.libraries.write(str(out), {scene, placed.object}, fake_user=True, compress=True)
