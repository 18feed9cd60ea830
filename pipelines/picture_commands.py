"""``rauca picture ...``: photographs and other simulators' pictures as frames of a data set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rauca_core.contract import RaucaError
from rauca_core.contract.color import find_colors

from .console import console
from .options import Blender, PaintMask, PaintMaterial

LEAST_IOU = 0.8
"""Roughly right cameras are above it; those given in another frame than the vehicle's are below."""

picture_app = typer.Typer(help="Photographs and other simulators' pictures.", no_args_is_help=True)


@picture_app.callback()
def _group() -> None:
    """Photographs and other simulators' pictures."""


@picture_app.command("add")
def picture_add(
    image: Annotated[Path, typer.Argument(help="a picture of the vehicle; grey bars make it square")],
    vehicle: Annotated[str, typer.Option(help="shipped vehicle's name, its folder, or an .obj, .glb or .blend")],
    out: Annotated[Path, typer.Option(help="data set of pictures to add it to; begun if it is not there")],
    camera: Annotated[Path | None, typer.Option(help="camera file: K, R, t, width, height, in the vehicle's frame")] = (
        None
    ),
    points: Annotated[Path | None, typer.Option(help="marked points to solve the camera from")] = None,
    mask: Annotated[Path | None, typer.Option(help="grey picture, white where the vehicle is seen")] = None,
    paint_color: Annotated[
        str | None,
        typer.Option(help="sRGB color of the vehicle's paint, as ff8800; told by the first picture if left out"),
    ] = None,
    paint_mask: PaintMask = None,
    paint_material: PaintMaterial = None,
    blender: Blender = None,
) -> None:
    """Add a picture of a vehicle: its camera given or solved, its light estimated."""
    from rauca_core.dataset_tools.stored import load_vehicle
    from rauca_core.pictures.add import add_picture

    colors = [] if paint_color is None else find_colors(paint_color)
    if len(colors) > 1:
        raise RaucaError(f"--paint-color {paint_color}: give one sRGB color like 8c8c8c")
    found = load_vehicle(vehicle, paint_mask, paint_material, blender)
    added = add_picture(image, found, out, camera, points, mask, colors[0] if colors else None)
    fit = added.fit
    if fit.points_px is not None:
        console.print(f"points: {fit.solved_px:.2f} pixels")
        console.print(f"camera: {fit.points_px:.2f} pixels, {fit.camera.fov_deg:.1f} degrees wide")
    if fit.iou is not None:
        console.print(f"silhouette IoU: {fit.iou:.4f}")
        if fit.iou < LEAST_IOU:
            console.print(
                f"warning: vehicle and mask overlap little ({fit.iou:.2f}, less than {LEAST_IOU}): is the camera in "
                "the vehicle's own frame, front +x, left +y, up +z, wheels on z = 0, in metres?",
                soft_wrap=True,
            )
    elif camera is not None:
        console.print("camera: taken as given, nothing checked it; look at the drawn fit, or give a --mask")
    if not colors:
        console.print(f"paint: {bytes(added.paint_srgb).hex()}, by the set's first picture")
    console.print(f"{added.frame.id}: {out}; fit drawn in {added.overlay}", soft_wrap=True)
