"""``rauca picture ...``: photographs and other simulators' pictures as frames of a data set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rauca_core.contract import RaucaError
from rauca_core.contract.color import find_colors

from .console import console

picture_app = typer.Typer(help="Photographs and other simulators' pictures.", no_args_is_help=True)


@picture_app.callback()
def _group() -> None:
    """Photographs and other simulators' pictures."""


@picture_app.command("add")
def picture_add(
    image: Annotated[Path, typer.Argument(help="a square picture of the vehicle")],
    vehicle: Annotated[str, typer.Option(help="shipped vehicle's name, or a vehicle folder")],
    out: Annotated[Path, typer.Option(help="data set of pictures to add it to; begun if it is not there")],
    camera: Annotated[Path | None, typer.Option(help="camera file: K, R, t, width, height, in the vehicle's frame")] = (
        None
    ),
    points: Annotated[Path | None, typer.Option(help="marked points to solve the camera from")] = None,
    mask: Annotated[Path | None, typer.Option(help="grey picture, white where the vehicle is seen")] = None,
    paint_color: Annotated[str, typer.Option(help="sRGB color of the vehicle's paint, as ff8800")] = "8c8c8c",
) -> None:
    """Add a picture of a vehicle: its camera given or solved, its light estimated."""
    from rauca_core.dataset_tools.stored import load_vehicle
    from rauca_core.pictures.fit import fit_camera, fit_points, read_camera
    from rauca_core.pictures.frame import add_picture, read_mask, read_picture
    from rauca_core.pictures.points import read_points

    if (camera is None) == (points is None):
        raise RaucaError("picture add: give either --camera or --points")
    pixels = read_picture(image)
    high, wide = pixels.shape[:2]
    found, seen = load_vehicle(vehicle), None if mask is None else read_mask(mask, wide, high)
    if camera is not None:
        fit = fit_camera(found, read_camera(camera, wide, high), seen)
    else:
        assert points is not None
        fit = fit_points(found, read_points(points), seen, (wide, high))
        console.print(f"points: {fit.solved_px:.2f} pixels")
        console.print(f"camera: {fit.points_px:.2f} pixels, {fit.camera.fov_deg:.1f} degrees wide")
    if fit.iou is not None:
        console.print(f"silhouette IoU: {fit.iou:.4f}")
    shown = fit.coverage if seen is None else seen
    made, overlay = add_picture(out, image.name, pixels, found, fit, shown, find_colors(paint_color)[0])
    console.print(f"{made.id}: {out}; fit drawn in {overlay}", soft_wrap=True)
