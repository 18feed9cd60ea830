"""A picture as a frame of a data set.

The frame names its picture in ``composed``: it was not rendered here and its light is estimated, so that it may be
learned from and looked at, and whoever averages rendered results refuses it by the rule that is there already.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ..contract import (
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
from ..contract.color import srgb_to_linear
from ..contract.files import SUMS_FILE, png_bytes, write_bytes, write_json
from ..contract.frame import PICTURE
from ..contract.semantics import mask_box
from ..environment import estimate_image, load_extractor
from ..environment.views.body import see_body
from ..environment.views.compose import as_stored
from ..environment.views.lens import Lens
from ..runtime.images import read_image
from .fit import Fit

WEATHER = Weather("picture", sun_altitude_angle=45.0)
"""Nobody knows a picture's weather: the name says so, the numbers are placeholders."""


def read_picture(path: Path) -> NDArray[np.uint8]:
    """(H, W, 3) 8-bit sRGB; grey ones get three channels."""
    pixels = read_image(path)
    return pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, 2)


def read_mask(path: Path, width: int, height: int) -> NDArray[np.float32]:
    """(H, W) in [0, 1] of a grey picture; raises :class:`RaucaError` for one of another size, or in color."""
    pixels = read_image(path)
    if pixels.shape != (height, width):
        raise RaucaError(f"{path}: must be grey and {width}x{height} pixels, as the picture is; not {pixels.shape}")
    return pixels.astype(np.float32) / 255


def add_picture(
    out: Path,
    name: str,
    image: NDArray[np.uint8],
    vehicle: Vehicle,
    fit: Fit,
    mask: NDArray[np.float32],
    paint_srgb: tuple[int, int, int],
) -> tuple[Frame, Path]:
    """Append a frame to the data set ``out``, begun if it is not there; returns it, and where its fit is drawn.

    Args:
        name: of the picture, for the frame's ``composed``.
        image: (S, S, 3) 8-bit sRGB.
        fit: the picture's camera.
        mask: (S, S) coverage of the vehicle in [0, 1]; where another thing hides it, 0.
        paint_srgb: 8-bit color of the vehicle's paint; one for the whole set.

    Raises:
        RaucaError: a picture that is not square; a set of another vehicle, size or paint, or of rendered frames.
    """
    if image.shape[0] != image.shape[1]:
        raise RaucaError(f"{name}: {image.shape[1]}x{image.shape[0]} pixels; frames are square: crop the picture first")
    camera = fit.camera
    eye = camera.position - (vehicle.positions.min(0) + vehicle.positions.max(0)) / 2
    distance = float(np.linalg.norm(eye))
    azimuth = float(np.degrees(np.arctan2(eye[1], eye[0])))
    elevation = float(np.degrees(np.arcsin(eye[2] / distance)))
    plan = _grown(Path(out), vehicle, len(image), paint_srgb, Ring((azimuth,), (elevation,), (distance,)))
    planned = plan.frames()[-1]
    body = see_body(vehicle, camera)
    away = np.where(body.depth > 0, body.depth * Lens.of(camera).lengths(*mask.shape), np.inf).astype(np.float32)
    shown = as_stored(body.paint * mask)
    light = estimate_image(image, shown, plan.reference_srgb, load_extractor()[0])
    expected = body.paint.sum()
    visible = float(np.clip(shown.sum() / expected, 0, 1)) if expected else 0.0
    frame = Frame(
        planned.id, planned.location, planned.view, camera, np.eye(4), WEATHER, azimuth, elevation, distance,
        mask_box(mask >= 0.5), visible, 0, composed=(f"{PICTURE}{name}",),
    )  # fmt: skip
    linear = srgb_to_linear(image / 255.0)
    save_frame(frame_folder(out, frame.id), frame, FramePasses(linear, mask, shown, away, light.A, light.B))
    (Path(out) / SUMS_FILE).unlink(missing_ok=True)  # the plan grows with every picture: seal it anew
    overlay = Path(out) / "fits" / f"{frame.id}.png"
    write_bytes(overlay, png_bytes(_draw_fit(image, fit.coverage, mask)))
    write_json(Path(out) / "dataset.json", plan.to_json())
    append_entry(out, LedgerEntry(frame.id, "done"))
    seal_dataset(out)
    return frame, overlay


def _grown(out: Path, vehicle: Vehicle, size: int, paint_srgb: tuple[int, int, int], ring: Ring) -> Plan:
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


def _draw_fit(image: NDArray[np.uint8], fitted: NDArray[np.float32], mask: NDArray[np.float32]) -> NDArray[np.uint8]:
    """The picture (H, W, 3) with the mask's outline in red and the fitted vehicle's in green."""
    drawn = image.copy()  # a picture just read may be read-only
    for coverage, color in ((mask, (255, 0, 0)), (fitted, (0, 255, 0))):
        lines, _ = cv2.findContours((coverage >= 0.5).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(drawn, lines, -1, color, 1)
    return drawn
