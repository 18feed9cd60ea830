"""Render the add-on's small pictures of every shipped weather: ``python tools/weather_thumbnails.py``.

They are frames as a data set has them, rain included. Weathers of one name in several lists share a picture.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from rauca_core.contract import Dataset, RaucaError, Weather, frame_folder, load_weathers, save_weathers
from rauca_core.contract.assets import assets_folder

SIZE, JPEG_QUALITY = 112, 82
# One view that shows the sky, the street with its kerb, facades, and the vehicle with its shadow.
VIEW = {"azimuths": "28.0", "elevations": "5", "distances": "6.5", "fov": "52", "samples": "12", "size": str(SIZE)}


def shipped_weathers() -> list[Weather]:
    """Every weather of the shipped lists once.

    Raises:
        RaucaError: two lists mean different weathers by one name.
    """
    known: dict[str, Weather] = {}
    for path in sorted((assets_folder() / "weathers").glob("*.json")):
        for weather in load_weathers(path):
            if known.setdefault(weather.name, weather) != weather:
                raise RaucaError(f"{path}: {weather.name} is another weather in another list; rename one")
    return list(known.values())


def main() -> None:
    """Render what is asked for and write ``assets/weathers/pictures/<weather>.jpg``."""
    pictures = assets_folder() / "weathers" / "pictures"
    pictures.mkdir(exist_ok=True)
    weathers = shipped_weathers()
    with tempfile.TemporaryDirectory(prefix="rauca-thumbnails-") as temporary:
        folder = Path(temporary)
        save_weathers(folder / "all.json", weathers)
        job = Path(__file__).resolve().parent.parent / "pipelines" / "make_dataset.py"
        asked = {"out": str(folder / "set"), "weathers": str(folder / "all.json")} | VIEW
        options = [f"--{name}={value}" for name, value in asked.items()]
        subprocess.run([sys.executable, str(job), *options, "--no-light", "--no-composed-fog"], check=True)
        for frame in Dataset(folder / "set").frames():
            picture = Image.open(frame_folder(folder / "set", frame.id) / "image.png").convert("RGB")
            picture.save(pictures / f"{frame.weather.name}.jpg", quality=JPEG_QUALITY, optimize=True)


if __name__ == "__main__":
    main()
