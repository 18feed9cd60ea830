"""A picture as a frame of a data set.

The frame names its picture in ``composed``: it was not rendered here and its light is estimated. It may be learned
from, looked at and judged on beside other pictures; whoever averages rendered results refuses it.

Frames are square: a picture that is not is laid on grey bars, as detectors lay it, and its camera is moved with it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..contract import (
    Camera,
    Frame,
    FramePasses,
    LedgerEntry,
    Plan,
    RaucaError,
    Ring,
    Vehicle,
    Weather,
    append_entry,
    frame_folder,
    load_vehicle,
    read_plan,
    save_frame,
    seal_dataset,
)
from ..contract.color import Color, srgb_to_linear
from ..contract.files import SUMS_FILE, png_bytes, write_bytes, write_json
from ..contract.frame import PICTURE
from ..contract.semantics import mask_box
from ..environment import estimate_image, load_extractor
from ..environment.views.body import Body
from ..environment.views.compose import as_stored
from ..environment.views.lens import Lens
from ..runtime.images import read_image
from .fit import Fit

WEATHER = Weather("picture", sun_altitude_angle=45.0)
"""Nobody knows a picture's weather: the name says so, the numbers are placeholders."""
BARS = 114  # sRGB, the grey that YOLO's detectors lay pictures on


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture and what is known of it.

    Attributes:
        name: for the frame's ``composed``.
        image: (H, W, 3) 8-bit sRGB.
        fit: its camera.
        mask: (H, W) coverage of the vehicle in [0, 1]; where another thing hides it, 0.
        body: what the camera sees of the vehicle.
    """

    name: str
    image: NDArray[np.uint8]
    fit: Fit
    mask: NDArray[np.float32]
    body: Body


def paint_of(out: Path) -> Color | None:
    """8-bit sRGB color of the paint in a set of pictures; None where there is no set yet."""
    return read_plan(out).reference_srgb if (Path(out) / "dataset.json").is_file() else None


def add_frame(out: Path, shot: Shot, vehicle: Vehicle, paint_srgb: Color) -> tuple[Frame, Path]:
    """Append a frame to the data set ``out``, begun if it is not there; returns it, and where its fit is drawn.

    Args:
        paint_srgb: 8-bit color of the vehicle's paint; one for the whole set.

    Raises:
        RaucaError: a set of another vehicle, size or paint, or of rendered frames.
    """
    out, (high, wide) = Path(out), shot.mask.shape
    eye = shot.fit.camera.position - (vehicle.positions.min(0) + vehicle.positions.max(0)) / 2
    distance = float(np.linalg.norm(eye))
    azimuth = float(np.degrees(np.arctan2(eye[1], eye[0])))
    elevation = float(np.degrees(np.arcsin(eye[2] / distance)))
    plan = _grown(out, vehicle, max(high, wide), paint_srgb, Ring((azimuth,), (elevation,), (distance,)))
    planned, passes = plan.frames()[-1], _passes(shot, paint_srgb)
    expected = shot.body.paint.sum()
    visible = float(np.clip(passes.paint.sum() / expected, 0, 1)) if expected else 0.0
    frame = Frame(
        planned.id, planned.location, planned.view, _squared_camera(shot.fit.camera), np.eye(4), WEATHER, azimuth,
        elevation, distance, mask_box(passes.vehicle >= 0.5), visible, 0, composed=(f"{PICTURE}{shot.name}",),
    )  # fmt: skip
    save_frame(frame_folder(out, frame.id), frame, passes)
    (out / SUMS_FILE).unlink(missing_ok=True)  # the plan grows with every picture: seal it anew
    overlay = out / "fits" / f"{frame.id}.png"
    write_bytes(overlay, png_bytes(_draw_fit(shot)))
    write_json(out / "dataset.json", plan.to_json())
    append_entry(out, LedgerEntry(frame.id, "done"))
    seal_dataset(out)
    return frame, overlay


def _passes(shot: Shot, paint_srgb: Color) -> FramePasses:
    """The frame's images, square; light is estimated before there are bars."""
    camera, depth = shot.fit.camera, shot.body.depth
    away = np.where(depth > 0, depth * Lens.of(camera).lengths(*depth.shape), np.inf).astype(np.float32)
    shown = as_stored(shot.body.paint * shot.mask)
    light = estimate_image(shot.image, shown, paint_srgb, load_extractor()[0])
    bars = float(srgb_to_linear(np.array([BARS / 255]))[0])
    return FramePasses(
        image_linear=_squared(srgb_to_linear(shot.image / 255.0), bars),
        vehicle=_squared(shot.mask, 0.0),
        paint=_squared(shown, 0.0),
        distance=_squared(away, np.inf),
        A=_squared(light.A, 0.0),
        B=_squared(light.B, bars),
    )


def _bars(height: int, width: int) -> tuple[tuple[int, int], tuple[int, int]]:
    """Pixels above and below, left and right, that make a picture square."""
    side = max(height, width)
    up, left = (side - height) // 2, (side - width) // 2
    return (up, side - height - up), (left, side - width - left)


def _squared(pixels: NDArray[Any], value: float) -> NDArray[Any]:
    """(H, W) or (H, W, C) between bars of a value."""
    bars = _bars(*pixels.shape[:2])
    return np.pad(pixels, (*bars, *((0, 0),) * (pixels.ndim - 2)), constant_values=value)


def _squared_camera(camera: Camera) -> Camera:
    """The camera of a picture between its bars."""
    (up, _), (left, _) = _bars(camera.height, camera.width)
    K, side = camera.K.copy(), max(camera.height, camera.width)
    K[:2, 2] += left, up
    return Camera(K, camera.R, camera.t, side, side)


def _grown(out: Path, vehicle: Vehicle, size: int, paint_srgb: Color, ring: Ring) -> Plan:
    """The set's plan with one place more; each picture is a place of its own, seen by one camera."""
    if not (out / "dataset.json").is_file():
        vehicle.save(out / "vehicle")
        return Plan.of(
            [WEATHER], ring, name=out.name, vehicle_name=vehicle.name, atlas_id=vehicle.atlas_id, size=size,
            reference_srgb=paint_srgb, min_visible=0.0,
        )  # fmt: skip
    plan = read_plan(out)
    if plan.weathers != (WEATHER,):
        raise RaucaError(f"{out}: holds rendered frames; give pictures a folder of their own")
    if load_vehicle(out / "vehicle", read_image).changed(vehicle):
        raise RaucaError(f"{out}: holds pictures of another vehicle, {plan.vehicle_name}; choose another folder")
    if (plan.size, plan.reference_srgb) != (size, paint_srgb):
        told = f"{plan.size} pixels in paint {bytes(plan.reference_srgb).hex()}"
        raise RaucaError(f"{out}: holds pictures of {told}; scale this one, give its --paint-color, or another folder")
    return replace(plan, locations=plan.locations + 1)


def _draw_fit(shot: Shot) -> NDArray[np.uint8]:
    """The picture (H, W, 3) with the mask's outline in red and the fitted vehicle's in green."""
    drawn = shot.image.copy()  # a picture just read may be read-only
    for coverage, color in ((shot.mask, (255, 0, 0)), (shot.fit.coverage, (0, 255, 0))):
        lines, _ = cv2.findContours((coverage >= 0.5).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(drawn, lines, -1, color, 1)
    return drawn
