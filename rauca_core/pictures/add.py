"""``rauca picture add``: from a picture's files to a frame of a data set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contract import Frame, RaucaError, Vehicle
from ..contract.color import Color
from ..environment.dichromatic import find_paint_color
from ..environment.views.body import see_body
from ..runtime.images import read_image
from .fit import Fit, fit_camera, fit_points, read_camera
from .frame import Shot, add_frame, paint_of
from .points import read_points


@dataclass(frozen=True, eq=False)
class Added:
    """A picture that has become a frame.

    Attributes:
        overlay: where its fit is drawn.
        paint_srgb: 8-bit color of its paint, given or found.
    """

    frame: Frame
    fit: Fit
    overlay: Path
    paint_srgb: Color


def add_picture(
    image: Path,
    vehicle: Vehicle,
    out: Path,
    camera: Path | None = None,
    points: Path | None = None,
    mask: Path | None = None,
    paint_srgb: Color | None = None,
) -> Added:
    """Make a frame of a picture, and append it to the data set ``out``, begun if it is not there.

    Args:
        camera: its camera's file; or
        points: marked points to solve it from.
        mask: grey picture, white where the vehicle is seen; the fitted vehicle if left out.
        paint_srgb: 8-bit color of the vehicle's paint, one for the whole set; if left out, that of the set's first
            picture, which is told by the picture.

    Raises:
        RaucaError: neither a camera nor points, or both; files that are damaged or do not fit each other; no camera
            sees the points like this; a set of another vehicle, size or paint, or of rendered frames.
    """
    if (camera is None) == (points is None):
        raise RaucaError(f"{image}: give either its --camera or --points marked in it")
    pixels = _read_picture(image)
    high, wide = pixels.shape[:2]
    seen = None if mask is None else _read_mask(mask, wide, high)
    if camera is not None:
        fit = fit_camera(vehicle, read_camera(camera, wide, high), seen)
    else:
        assert points is not None
        fit = fit_points(vehicle, read_points(points), seen, (wide, high))
    shown = fit.coverage if seen is None else seen
    body = see_body(vehicle, fit.camera)
    if not (body.paint * shown >= 0.5).any():
        raise RaucaError(f"{image}: shows none of the vehicle's paint there; look at its camera, points and mask")
    color = paint_srgb or paint_of(out) or find_paint_color(pixels, body.paint * shown)
    frame, overlay = add_frame(out, Shot(image.name, pixels, fit, shown, body), vehicle, color)
    return Added(frame, fit, overlay, color)


def _read_picture(path: Path) -> NDArray[np.uint8]:
    """(H, W, 3) 8-bit sRGB; grey ones get three channels."""
    pixels = read_image(path)
    return pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, 2)


def _read_mask(path: Path, width: int, height: int) -> NDArray[np.float32]:
    """(H, W) in [0, 1] of a grey picture; raises :class:`RaucaError` for one of another size, or in color."""
    pixels = read_image(path)
    if pixels.shape != (height, width):
        raise RaucaError(f"{path}: must be grey and {width}x{height} pixels, as the picture is; not {pixels.shape}")
    return pixels.astype(np.float32) / 255
