"""``rauca picture ...``: photographs and other simulators' pictures as frames of a data set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rauca_core.contract import Camera, RaucaError, load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.color import find_colors
from rauca_core.contract.files import png_bytes, write_bytes
from rauca_core.contract.schema import read_json

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
    import numpy as np

    from rauca_core.pictures.frame import add_picture, draw_fit
    from rauca_core.pictures.points import read_points
    from rauca_core.pictures.silhouette import coverage, iou, refine
    from rauca_core.pictures.solve import reprojection_px, solve_camera
    from rauca_core.runtime.images import read_image

    if (camera is None) == (points is None):
        raise RaucaError("picture add: give either --camera or --points")
    pixels = read_image(image)
    pixels = pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, 2)
    high, wide = pixels.shape[:2]
    folder = assets_folder() / "vehicles" / vehicle
    found = load_vehicle(folder if (folder / "vehicle.json").is_file() else Path(vehicle), read_image)
    seen = None if mask is None else read_image(mask).astype(np.float32) / 255
    if seen is not None and seen.shape != (high, wide):
        raise RaucaError(f"{mask}: must be grey and {wide}x{high} pixels, as the picture is; not {seen.shape}")
    if camera is not None:
        known = Camera.from_json(read_json(camera))
        if (known.width, known.height) != (wide, high):
            raise RaucaError(f"{camera}: of {known.width}x{known.height} pixels, the picture has {wide}x{high}")
    else:
        assert points is not None
        marked = read_points(points)
        known = solve_camera(marked, wide, high)
        console.print(f"points: {reprojection_px(known, marked):.2f} pixels, {known.fov_deg:.1f} degrees wide")
        if seen is not None:
            known = refine(found, known, seen, marked)
            console.print(f"refined: {reprojection_px(known, marked):.2f} pixels, {known.fov_deg:.1f} degrees wide")
    fitted = coverage(found, known)
    if seen is not None:
        console.print(f"silhouette IoU: {iou(fitted, seen):.4f}")
    shown = fitted if seen is None else seen
    made = add_picture(out, image.name, pixels, found, known, shown, find_colors(paint_color)[0])
    overlay = out / "fits" / f"{made.id}.png"
    overlay.parent.mkdir(exist_ok=True)
    write_bytes(overlay, png_bytes(draw_fit(pixels, fitted, shown)))
    console.print(f"{made.id}: {out}; fit drawn in {overlay}", soft_wrap=True)
