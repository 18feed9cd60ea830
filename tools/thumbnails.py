"""Render the add-on's small pictures: ``python -m tools.thumbnails weathers`` or ``... vehicles``.

Those of weathers are frames as a data set has them, rain included; weathers of one name in several lists share a
picture. Those of vehicles are the views of ``tools.vehicle_sheet``.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from PIL import Image

from rauca_core import contract
from rauca_core.contract.assets import assets_folder
from rauca_core.runtime.blender import run_blender
from rauca_core.runtime.images import read_image

SIZE, JPEG_QUALITY = 112, 82
# One view that shows the sky, the street with its kerb, facades, and the vehicle with its shadow.
RING = contract.Ring((28.0,), (5.0,), (6.5,), fov_deg=52.0)
QUALITY = contract.Quality(samples=12, composed_fog=False)


def shipped_weathers() -> list[contract.Weather]:
    """Every weather of the shipped lists once; raises :class:`RaucaError` where two mean different ones by a name."""
    known: dict[str, contract.Weather] = {}
    for path in sorted((assets_folder() / "weathers").glob("*.json")):
        for weather in contract.find_preset(path.stem):
            if known.setdefault(weather.name, weather) != weather:
                raise contract.RaucaError(f"{path}: {weather.name} is another weather in another list; rename one")
    return list(known.values())


def weathers() -> None:
    """Write ``assets/weathers/pictures/<weather>.jpg``."""
    pictures = assets_folder() / "weathers" / "pictures"
    pictures.mkdir(exist_ok=True)
    shipped = tuple(shipped_weathers())
    plan = contract.Plan(
        "small", "", "", SIZE, QUALITY, False, shipped, RING, 1, contract.REFERENCE_SRGB, contract.MIN_VISIBLE, 0, ""
    )
    with tempfile.TemporaryDirectory(prefix="rauca-thumbnails-") as temporary:
        folder = Path(temporary)
        run_blender(contract.MakeDataset(folder / "set", plan), lambda progress: print(progress.done, progress.last))
        for frame in contract.Dataset(folder / "set").frames():
            picture = Image.open(contract.frame_folder(folder / "set", frame.id) / "image.png").convert("RGB")
            _save(picture, pictures / f"{frame.weather.name}.jpg")


def vehicles() -> None:
    """Write ``assets/vehicles/<vehicle>.jpg``."""
    from .vehicle_sheet import SHOWN, picture  # renders in this process, which must not load bpy before a data set's

    for name, azimuth, distance, paint in SHOWN:
        vehicle = contract.load_vehicle(assets_folder() / "vehicles" / name, read_image)
        pixels = picture(vehicle, azimuth, distance, paint, SIZE, SIZE)
        _save(Image.fromarray(pixels), assets_folder() / "vehicles" / f"{name}.jpg")


def _save(picture: Image.Image, path: Path) -> None:
    picture.save(path, quality=JPEG_QUALITY, optimize=True)


if __name__ == "__main__":
    {"weathers": weathers, "vehicles": vehicles}[sys.argv[1]]()
