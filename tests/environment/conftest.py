"""Data sets drawn by numpy in place of Blender: a lit box in fog of two densities, at several places."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.stability.drawn import around
from rauca_core.contract import (
    Camera,
    Dataset,
    Frame,
    FramePasses,
    Plan,
    Quality,
    Ring,
    Vehicle,
    Weather,
    claim_folder,
    save_frame,
)
from rauca_core.contract.color import srgb_to_linear
from rauca_core.render import rasterize

torch.set_num_threads(1)

WEATHERS = (Weather("clear", 45.0), Weather("fog", 45.0, fog_density=80.0))
REFERENCE = (140, 140, 140)


def draw_frame(vehicle: Vehicle, camera: Camera, light: np.ndarray, fog: float) -> FramePasses:
    """Lambert shading from one direction, then fog: A = t * shade, B = t * rest + (1 - t) * airlight."""
    ids = rasterize(vehicle.positions, vehicle.triangles, camera).whole(camera.width, camera.height)
    shade = 0.15 + 0.8 * np.maximum(vehicle.normals.mean(1) @ light, 0)
    seen, paint = ids >= 0, np.zeros(ids.shape, bool)
    paint[seen] = vehicle.paint_faces()[ids[seen]]
    A, B = np.zeros((*ids.shape, 3), np.float32), np.full((*ids.shape, 3), 0.35, np.float32)
    B[seen] = np.array([m.base_color for m in vehicle.materials])[vehicle.material][ids[seen]] * shade[ids[seen], None]
    A[paint], B[paint] = shade[ids[paint], None], 0.02
    passes = FramePasses(A, seen.astype(np.float32), paint.astype(np.float32), seen * np.float32(7))
    passes.A, passes.B = A * (1 - fog), B * (1 - fog) + fog * 0.6
    passes.image_linear = passes.A * srgb_to_linear(np.array(REFERENCE) / 255) + passes.B
    return passes


def draw_dataset(
    folder: Path, vehicle: Vehicle, size: int = 32, views: int = 2, locations: int = 2, light: bool = True
) -> Dataset:
    ring = Ring(tuple(360.0 * i / views for i in range(views)), (12.0,), (7.0,))
    plan = Plan(
        folder.name, vehicle.name, vehicle.atlas_id, size, Quality(1), light, WEATHERS, ring, locations, REFERENCE,
        0.5, 0, "none",
    )  # fmt: skip
    claim_folder(folder, plan)
    vehicle.save(folder / "vehicle")
    for frame_id, location, view, weather in plan.frames():
        camera, sun = around(40 + 360 * view / views, size), location * 1.3
        passes = draw_frame(vehicle, camera, np.array([np.cos(sun), np.sin(sun), 0.6]) / 1.2, weather.fog_density / 160)
        rows, columns = np.nonzero(passes.vehicle)
        box = tuple(float(v) for v in (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1))
        if not light:
            passes.A = passes.B = None
        frame = Frame(frame_id, location, view, camera, np.eye(4), weather, 0.0, 12.0, 7.0, box, 1.0, 0)
        save_frame(folder / "frames" / frame_id, frame, passes)
    return Dataset(folder)


@pytest.fixture
def dataset_factory() -> Callable[..., Dataset]:
    return draw_dataset


@pytest.fixture
def dataset(tmp_path: Path, box_vehicle: Vehicle) -> Dataset:
    return draw_dataset(tmp_path / "data", box_vehicle)
