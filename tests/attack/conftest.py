"""Data sets made by numpy in place of Blender, and a detector small enough to take many steps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

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
from rauca_core.contract.files import append_line
from rauca_core.detect import DensePredictions, Detections
from rauca_core.render import rasterize

torch.set_num_threads(1)

WEATHERS = (Weather("day", 45.0), Weather("dusk", 5.0))
GREY = 140


def shaded_frame(
    vehicle: Vehicle, camera: Camera, frame_id: str, view: int, weather: Weather
) -> tuple[Frame, FramePasses]:
    """Lambert shading with sharp edges: A on the paint, B a street of two greys and the rest of the vehicle."""
    raster = rasterize(vehicle.positions, vehicle.triangles, camera)
    ids = np.full((camera.height, camera.width), -1)
    height, width = raster.face_ids.shape
    ids[raster.y0 : raster.y0 + height, raster.x0 : raster.x0 + width] = raster.face_ids
    light = np.array([0.3, 0.5, 0.8]) * (1.0 if weather.sun_altitude_angle > 30 else 0.4)
    shade = 0.15 + 0.8 * np.abs(vehicle.normals.mean(1) @ light)
    seen, paint = ids >= 0, np.zeros(ids.shape, bool)
    paint[seen] = vehicle.paint_faces()[ids[seen]]
    A, B = np.zeros((*ids.shape, 3), np.float32), np.full((*ids.shape, 3), 0.35, np.float32)
    B[camera.height // 2 :] = 0.12
    colours = np.array([m.base_color for m in vehicle.materials])[vehicle.material]
    B[seen] = colours[ids[seen]] * shade[ids[seen], None]
    A[paint], B[paint] = shade[ids[paint], None], 0.01
    rows, columns = np.nonzero(seen)
    box = (columns.min(), rows.min(), columns.max() + 1, rows.max() + 1) if len(rows) else None
    frame = Frame(
        frame_id, 0, view, camera, np.eye(4), weather, 0.0, 10.0, 7.0,
        None if box is None else tuple(float(b) for b in box), 1.0, 0,
    )  # fmt: skip
    passes = FramePasses(A * 0.25 + B, seen.astype(np.float32), paint.astype(np.float32), seen * np.float32(7), A, B)
    return frame, passes


def make_dataset(folder: Path, vehicle: Vehicle, size: int, azimuths: tuple[float, ...], light: bool = True) -> Dataset:
    ring = Ring(azimuths, (12.0,), (7.0,))
    plan = Plan(
        "test", vehicle.name, vehicle.atlas_id, size, Quality(1), light, WEATHERS, ring, 1, (GREY,) * 3, 0.5, 0, "none"
    )
    claim_folder(folder, plan)
    vehicle.save(folder / "vehicle")
    for frame_id, _, view, weather in plan.frame_ids():
        azimuth = np.radians(azimuths[view])
        eye = np.array([6.8 * np.cos(azimuth), 6.8 * np.sin(azimuth), 2.2])
        camera = Camera.look_at(eye, np.array([0, 0, 0.7]), 45, size, size)
        frame, passes = shaded_frame(vehicle, camera, frame_id, view, weather)
        save_frame(folder / "frames" / frame_id, frame, passes)
        append_line(folder / "ledger.jsonl", frame_id)
    return Dataset(folder)


@pytest.fixture
def dataset_factory() -> Callable[..., Dataset]:
    return make_dataset


@pytest.fixture
def dataset(tmp_path: Path, box_vehicle: Vehicle) -> Dataset:
    return make_dataset(tmp_path / "data", box_vehicle, 64, (40.0, 130.0, 250.0))


class FirstLayer(nn.Module):
    def __init__(self, weight: Tensor) -> None:
        super().__init__()
        self.weight = weight

    def forward(self, images: Tensor) -> Tensor:
        return nn.functional.conv2d(images, self.weight.to(images), stride=8).tanh()


class SmallDetector:
    """Two seeded convolutions that predict a box, objectness and two classes per cell: numerics, not sight."""

    name = "small"
    fingerprint = "0123"
    class_names = ("boat", "car")

    def __init__(self) -> None:
        generator = torch.Generator().manual_seed(0)
        self.first = FirstLayer(torch.randn(8, 3, 8, 8, generator=generator) * 0.1)
        self._second = torch.randn(7, 8, 3, 3, generator=generator) * 0.2

    def dense(self, images: Tensor) -> DensePredictions:
        hidden = self.first(images)
        out = torch.nn.functional.conv2d(hidden, self._second.to(images), padding=1)
        batch, _, rows, columns = out.shape
        y, x = torch.meshgrid(torch.arange(rows) * 8.0 + 4, torch.arange(columns) * 8.0 + 4, indexing="ij")
        centre = torch.stack([x, y]) + 4 * out[:, 0:2].tanh()
        half = 16 * torch.exp(out[:, 2:4])
        boxes = torch.cat([centre - half, centre + half], 1).reshape(batch, 4, -1).transpose(1, 2)
        objectness = out[:, 4].reshape(batch, -1).sigmoid()
        return DensePredictions(boxes, objectness, out[:, 5:7].reshape(batch, 2, -1).transpose(1, 2).sigmoid())

    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        raise NotImplementedError("the optimiser reads predictions before suppression")


@pytest.fixture
def small_detector() -> SmallDetector:
    return SmallDetector()
