"""In a process of its own, with Blender: frames of a data set rendered anew, textured or as light maps."""

from __future__ import annotations

import io
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from blender_addon.core import color, contract, files
from blender_addon.scene import camera, render
from blender_addon.scene.camouflages import read_paintwork
from blender_addon.scene.frame import Light, rain_before
from blender_addon.scene.images import read_image_blender
from blender_addon.scene.light_maps import light_maps
from blender_addon.scene.session import LightMemory, Session

MARGIN_PX = 2


def main(dataset: str, camouflages: dict[str, str], out: str, jobs: list[dict[str, Any]]) -> None:
    """Render ``jobs``, an `environment_truth.Budget` with a ``name`` each, into ``out/<name>.npz``.

    That holds ``image``, or ``A`` and ``B``, (H, W, 3) linear float32 in the frame's exposure and behind its rain, and
    ``seconds`` of CPU. An image is 0 where no paint is, unless it is wanted whole.
    """
    data = contract.Dataset(Path(dataset))
    session = Session(data.plan, contract.load_vehicle(data.vehicle_folder, read_image_blender))
    frames = {frame.id: frame for frame in data.frames()}
    maps = {name: read_paintwork(Path(path), data.plan.atlas_id).uv_map_srgb for name, path in camouflages.items()}
    present, painted = None, None
    for number, job in enumerate(jobs):
        frame = frames[job["frame"]]
        if present != (frame.location, frame.weather):
            session.enter(frame.location)
            session.set_weather(frame.weather)
            present, painted = (frame.location, frame.weather), None
        if job["paint"] != "light" and painted != job["paint"]:
            session.vehicle.paint.set_map(maps[job["paint"]])
        painted = job["paint"]
        arrays = io.BytesIO()
        np.savez_compressed(arrays, **_rendered(session, data, frame, job))
        files.write_bytes(Path(out) / f"{job['name']}.npz", arrays.getvalue())
        print(contract.Progress(number + 1, len(jobs), job["paint"]).line(), flush=True)


def _rendered(
    session: Session, dataset: contract.Dataset, frame: contract.Frame, job: dict[str, Any]
) -> dict[str, np.ndarray]:
    plan = dataset.plan
    quality = replace(plan.quality, samples=job["samples"], denoise=job["denoise"])
    paint = read_image_blender(dataset.frame_folder(frame.id) / "paint.png")
    coverage = (paint if paint.ndim == 2 else paint[..., 0]).astype(np.float32) / np.float32(255)
    if job["paint"] == "light":
        session.plan = replace(plan, quality=quality)
        session.memory = LightMemory(session.plan)  # no light of another job, of other samples
        reference = color.srgb_to_linear(np.array(plan.reference_srgb) / 255)
        started = time.process_time()
        A, B, image = light_maps(session, frame.location, frame.view, frame.weather, coverage, reference)
        seen = _as_in_the_frame(session, dataset, frame, Light(image, A, B))
        assert seen.A is not None
        assert seen.B is not None
        return {"A": seen.A, "B": seen.B, "seconds": np.array(time.process_time() - started)}
    crop = render.Crop.around((coverage > 0) | job["whole"], MARGIN_PX)
    image = np.zeros((*coverage.shape, 3), np.float32)
    started = time.process_time()
    camera.place(session.scene, session.viewpoint(frame.location, frame.view).camera)
    seed = session.seed(frame.location, frame.view, frame.weather) + job["seed"]
    if crop is not None:
        image[crop.inside] = render.render_linear(session.scene, quality, seed, crop)[..., :3]
    seconds = np.array(time.process_time() - started)
    return {"image": _as_in_the_frame(session, dataset, frame, Light(image)).image, "seconds": seconds}


def _as_in_the_frame(session: Session, dataset: contract.Dataset, frame: contract.Frame, light: Light) -> Light:
    light = light.exposed(frame.exposure_stops)
    (distance,) = contract.load_passes(dataset.frame_folder(frame.id), ("distance",)).values()
    return light.behind(rain_before(session, frame.location, frame.view, frame.weather, distance))
