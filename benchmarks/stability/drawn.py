"""The smallest painted vehicle, and data sets drawn by numpy in place of Blender, in milliseconds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rauca_core.contract import (
    Camera,
    Dataset,
    Frame,
    FramePasses,
    Material,
    Plan,
    Quality,
    Ring,
    Vehicle,
    Weather,
    claim_folder,
    save_frame,
)
from rauca_core.contract.files import append_line
from rauca_core.render import rasterize

Maps = NDArray[np.float32]
Box = tuple[float, float, float, float]

WEATHERS = (Weather("day", 45.0), Weather("dusk", 5.0))
GREY = 140
ELEVATION, DISTANCE_M, CENTER = 12.0, 7.0, (0.0, 0.0, 0.7)


def around(azimuth_deg: float, size: int) -> Camera:
    """A camera on a ring about a vehicle at the origin, seven metres away."""
    azimuth = np.radians(azimuth_deg)
    eye = np.array([6.8 * np.cos(azimuth), 6.8 * np.sin(azimuth), 2.2])
    return Camera.look_at(eye, np.array(CENTER), 45, size, size)


def as_drawn(A: Maps, B: Maps) -> tuple[Maps, Maps]:
    return A, B


@dataclass(frozen=True)
class Look:
    """How the frames of a data set are made."""

    camera: Callable[[float, int], Camera] = around  # from an azimuth in degrees and the image's side in pixels
    light: Callable[[Maps, Maps], tuple[Maps, Maps]] = as_drawn  # changes A and B (H, W, 3), linear
    box: Box | None = None  # the vehicle's, in shares of the image's side; what is drawn, if left out


AS_IT_IS = Look()


def draw_frame(
    vehicle: Vehicle, camera: Camera, frame_id: str, view: int, weather: Weather, look: Look = AS_IT_IS
) -> tuple[Frame, FramePasses]:
    """Lambert shading with sharp edges: A on the paint, B a street of two greys and the rest of the vehicle."""
    ids = rasterize(vehicle.positions, vehicle.triangles, camera).whole(camera.width, camera.height)
    seen, paint = ids >= 0, np.zeros(ids.shape, bool)
    paint[seen] = vehicle.paint_faces()[ids[seen]]
    A, B = look.light(*_shaded(vehicle, ids, paint, 1.0 if weather.sun_altitude_angle > 30 else 0.4))
    frame = Frame(
        frame_id, 0, view, camera, np.eye(4), weather, 0.0, ELEVATION, DISTANCE_M,
        _box(seen, look.box), 1.0, 0,
    )  # fmt: skip
    passes = FramePasses(A * 0.25 + B, seen.astype(np.float32), paint.astype(np.float32), seen * np.float32(7), A, B)
    return frame, passes


def make_dataset(
    folder: Path, vehicle: Vehicle, size: int, azimuths: tuple[float, ...], light: bool = True, look: Look = AS_IT_IS
) -> Dataset:
    """From some sides, by day and at dusk; ``light`` is what its plan says of light maps."""
    ring = Ring(azimuths, (ELEVATION,), (DISTANCE_M,))
    plan = Plan(
        "test", vehicle.name, vehicle.atlas_id, size, Quality(1), light, WEATHERS, ring, 1, (GREY,) * 3, 0.5, 0, "none"
    )
    claim_folder(folder, plan)
    vehicle.save(folder / "vehicle")
    for frame_id, _, view, weather in plan.frames():
        frame, passes = draw_frame(vehicle, look.camera(azimuths[view], size), frame_id, view, weather, look)
        save_frame(folder / "frames" / frame_id, frame, passes)
        append_line(folder / "ledger.jsonl", frame_id)
    return Dataset(folder)


def _shaded(vehicle: Vehicle, ids: NDArray[np.int32], paint: NDArray[np.bool_], brightness: float) -> tuple[Maps, Maps]:
    sun = np.array([0.3, 0.5, 0.8]) * brightness
    shade = 0.15 + 0.8 * np.abs(vehicle.normals.mean(1) @ sun)
    A, B = np.zeros((*ids.shape, 3), np.float32), np.full((*ids.shape, 3), 0.35, np.float32)
    B[ids.shape[0] // 2 :] = 0.12
    seen = ids >= 0
    colors = np.array([m.base_color for m in vehicle.materials])[vehicle.material]
    B[seen] = colors[ids[seen]] * shade[ids[seen], None]
    A[paint], B[paint] = shade[ids[paint], None], 0.01
    return A, B


def _box(seen: NDArray[np.bool_], shares: Box | None) -> Box | None:
    if shares is not None:
        left, top, right, bottom = (share * len(seen) for share in shares)
        return left, top, right, bottom
    rows, columns = np.nonzero(seen)
    if not len(rows):
        return None
    return float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1)


def painted_box() -> Vehicle:
    """A 4 x 2 x 1.5 m box: its sides painted, each a chart of its own, its top of dark trim."""
    x, y, z = 2.0, 1.0, 1.5
    corners = np.array([(sx * x, sy * y, h) for h in (0, z) for sy in (-1, 1) for sx in (-1, 1)], np.float32)
    quads = [(0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6), (4, 5, 7, 6)]
    normals = [(0, -1, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, 0, 1)]
    triangles, uvs, corner_normals, material = [], [], [], []
    for i, (quad, normal) in enumerate(zip(quads, normals, strict=True)):
        u, v = 0.05 + 0.5 * (i % 2), 0.05 + 0.5 * (i // 2 % 2)
        chart = np.array([(u, v), (u + 0.4, v), (u + 0.4, v + 0.4), (u, v + 0.4)])
        for order in ((0, 1, 2), (0, 2, 3)):
            triangles.append([quad[k] for k in order])
            uvs.append(chart[list(order)] if i < 4 else np.zeros((3, 2)))
            corner_normals.append([normal] * 3)
            material.append(0 if i < 4 else 1)
    mask = np.tile(np.pad(np.full((28, 28), 255, np.uint8), 2), (2, 2))
    return Vehicle(
        name="box",
        positions=corners,
        triangles=np.array(triangles, np.int32),
        uvs=np.array(uvs, np.float32),
        normals=np.array(corner_normals, np.float32),
        material=np.array(material, np.int16),
        materials=[Material("paint", "paint", roughness=0.5), Material("top", "trim", (0.02, 0.02, 0.02), 0.8)],
        paint_mask=mask,
        padding_texels=4,
    )
