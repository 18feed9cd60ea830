"""Render the plain cars that `rauca detectors check` shows a detector: ``python tools/preflight_pictures.py``.

Sedan and suv in grey paint, in a town that nothing else uses, six weathers, cameras from the street up to 30 degrees:
the balanced part that the plan gives, every other view of one car. None was chosen by hand or by a detector.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from PIL import Image

from rauca_core import contract
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.files import write_json
from rauca_core.contract.towns import TEST
from rauca_core.runtime.blender import run_blender
from rauca_core.study.plain_cars import PlainCar, PlainCars

SIZE, JPEG_QUALITY = 320, 90
VEHICLES = ("sedan", "suv")
WEATHERS = {
    "demo": ("clear-day", "low-sun", "light-fog"),
    "unseen": ("noon-overcast", "wet-after-shower", "dusk-clear"),
}
RING = contract.Ring((25.0, 75.0, 145.0, 205.0, 265.0, 325.0), (6.0, 14.0, 30.0), (6.0, 8.5), fov_deg=60.0)
TOWN = TEST["plain cars of detectors check"]
QUALITY = contract.Quality(samples=16, composed_fog=False)


def main() -> None:
    folder = assets_folder() / "preflight"
    folder.mkdir(exist_ok=True)
    weathers = [one for name, some in WEATHERS.items() for one in contract.find_preset(name) if one.name in some]
    plan = contract.Plan.of(weathers, RING, quality=QUALITY, light=False, size=SIZE, locations=2, seed=TOWN)
    chosen = contract.balanced_frames(plan, len(VEHICLES) * len(weathers))
    shown: dict[str, PlainCar] = {}
    with tempfile.TemporaryDirectory(prefix="rauca-preflight-") as temporary:
        for number, vehicle in enumerate(VEHICLES):
            data = Path(temporary) / vehicle
            frames = tuple(chosen[number :: len(VEHICLES)])
            job = contract.MakeDataset(data, plan, contract.VehicleSource(vehicle), frames=frames)
            run_blender(job, lambda progress: print(progress.done, progress.last))
            for frame in contract.Dataset(data).frames():
                assert frame.box_xyxy is not None
                name = f"{vehicle}-{frame.id}.jpg"
                picture = Image.open(contract.frame_folder(data, frame.id) / "image.png").convert("RGB")
                picture.save(folder / name, quality=JPEG_QUALITY, optimize=True)
                shown[frame.id] = PlainCar(name, frame.box_xyxy)
    pictures = tuple(shown[frame] for frame in chosen if frame in shown)
    write_json(folder / "pictures.json", PlainCars("python tools/preflight_pictures.py", pictures).to_json())


if __name__ == "__main__":
    main()
