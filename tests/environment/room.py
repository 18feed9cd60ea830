"""A room whose every view is known exactly: numpy casts one ray a pixel at a floor, four walls, a box and a pole.

Colors belong to points, not to views: a new camera sees what the others saw.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rauca_core.contract import (
    Camera,
    Dataset,
    Frame,
    FramePasses,
    LedgerEntry,
    Plan,
    Quality,
    Ring,
    Vehicle,
    Weather,
    append_entry,
    claim_folder,
    rain,
    save_frame,
    seal_dataset,
)
from rauca_core.contract.color import srgb_to_linear
from rauca_core.contract.semantics import CLASS_IDS, TARGET_INSTANCE, mask_box
from rauca_core.contract.viewpoints import viewpoint

SIZE = 80
POSE = np.array([[0.0, -1, 0, 1], [1, 0, 0, -0.5], [0, 0, 1, 0], [0, 0, 0, 1]])
REFERENCE = (140, 140, 140)
HALF, TALL = 15.0, 6.0  # metres: of the room's side, of its walls; above them is sky
FLOOR, WALL, POLE, BODY, SKY = "road", "building", "pole", "paint", "sky"
Slab = tuple[tuple[float, float, float], tuple[float, float, float]]
NO_POLE: tuple[Slab, ...] = ()


def colors(points: np.ndarray) -> np.ndarray:
    """Smooth colors (..., 3) of points (..., 3) of the surroundings."""
    x, y, z = np.moveaxis(points, -1, 0)
    return 0.3 + 0.2 * np.stack([np.sin(0.5 * x + z), np.cos(0.4 * y - z), np.sin(0.3 * (x + y) + 0.5 * z)], -1)


def rays(camera: Camera) -> np.ndarray:
    """Unit directions (H, W, 3) in the world."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    directions = np.stack([x, y, np.ones_like(x)], -1) @ np.linalg.inv(camera.K).T @ camera.R
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def meet_box(eye: np.ndarray, directions: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Distance (H, W) at which rays enter an axis-aligned box, infinity where they miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (low - eye) / directions, (high - eye) / directions
    enter, leave = np.minimum(one, two).max(-1), np.maximum(one, two).min(-1)
    return np.where((enter < leave) & (enter > 0), enter, np.inf)


def look(camera: Camera, poles: tuple[Slab, ...] = NO_POLE) -> FramePasses:
    """What a camera sees: light maps, distance and labels."""
    eye, directions = camera.position, rays(camera)
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(directions[..., 2] < 0, -eye[2] / directions[..., 2], np.inf)
        ends = np.where(directions > 0, HALF - eye, -HALF - eye)[..., :2] / directions[..., :2]
    wall = ends.min(-1)
    wall = np.where(eye[2] + wall * directions[..., 2] < TALL, wall, np.inf)
    local_eye, local = POSE[:3, :3].T @ (eye - POSE[:3, 3]), directions @ POSE[:3, :3]
    body = meet_box(local_eye, local, np.array([-2, -1, 0.0]), np.array([2, 1, 1.5]))
    pole = np.full(floor.shape, np.inf)
    for low, high in poles:
        pole = np.minimum(pole, meet_box(eye, directions, np.array(low), np.array(high)))
    every = np.stack([floor, wall, pole, body])
    which, distance = every.argmin(0), every.min(0)
    kinds = np.array([CLASS_IDS[name] for name in (FLOOR, WALL, POLE, BODY)], np.uint8)
    sky = np.isinf(distance)
    semantic = np.where(sky, np.uint8(CLASS_IDS[SKY]), kinds[which])
    with np.errstate(invalid="ignore"):
        points = eye + distance[..., None] * directions
    seen = (which == 3) & ~sky
    where = np.where(sky[..., None], 0.0, points)
    B = np.where(sky[..., None], 0.3 + 0.2 * directions[..., 2:] * np.ones(3), colors(where))
    B[(which == 2) & ~sky] = (0.9, 0.05, 0.05)
    top = seen & ((where[..., 2] > 1.499) | (where[..., 2] < 1e-6))
    B[seen], paint = 0.02 + 0.1 * colors(where)[seen], seen & ~top
    A = np.where(paint[..., None], 0.5 + 0.5 * colors(where), 0.0)
    semantic[top] = CLASS_IDS["vehicle_part"]
    passes = FramePasses(
        (A * srgb_to_linear(np.array(REFERENCE) / 255) + B).astype(np.float32), seen.astype(np.float32),
        paint.astype(np.float32), distance.astype(np.float32), A.astype(np.float32), B.astype(np.float32), semantic,
        np.where(seen, np.uint8(TARGET_INSTANCE), np.uint8(0)),
    )  # fmt: skip
    return passes


def make_room(
    folder: Path,
    vehicle: Vehicle,
    azimuths: tuple[float, ...] = tuple(30.0 * k for k in range(12)),
    weathers: tuple[Weather, ...] = (Weather("day", 45.0),),
    poles: tuple[Slab, ...] = NO_POLE,
    stops: float = 0.0,
    locations: int = 1,
) -> Dataset:
    """A data set of views at 12 and 24 degrees, 7 m away; rain and exposure as Blender puts them on.

    Every location is the same room.
    """
    ring = Ring(azimuths, (12.0, 24.0), (7.0,))
    plan = Plan.of(
        weathers, ring, name="room", vehicle_name=vehicle.name, atlas_id=vehicle.atlas_id, size=SIZE,
        quality=Quality(1), reference_srgb=REFERENCE, blender="none", locations=locations,
    )  # fmt: skip
    vehicle.save(folder / "vehicle")
    claim_folder(folder, plan)
    seal_dataset(folder)
    center = ((vehicle.positions.min(axis=0) + vehicle.positions.max(axis=0)) / 2).astype(np.float64)
    for task in plan.frames():
        seen_by = viewpoint(plan, task.location, task.view, POSE, center)
        passes = look(seen_by.camera, poles)
        frame = Frame(
            task.id, task.location, task.view, seen_by.camera, POSE, task.weather, seen_by.azimuth_deg,
            seen_by.elevation_deg, seen_by.distance_m, mask_box(passes.vehicle > 0.5), 1.0, 1, exposure_stops=stops,
        )  # fmt: skip
        save_frame(folder / "frames" / task.id, frame, developed(passes, frame, plan.seed))
        append_entry(folder, LedgerEntry(task.id, "done", 1.0))
    return Dataset(folder)


def developed(passes: FramePasses, frame: Frame, seed: int) -> FramePasses:
    """The passes after the frame's exposure and behind its rain."""
    assert passes.A is not None
    assert passes.B is not None
    bright = np.float32(2.0**frame.exposure_stops)
    passes.A, passes.B = passes.A * bright, passes.B * bright
    if frame.weather.precipitation:
        drops = rain.streaks(
            frame.weather,
            frame.camera,
            passes.distance.astype(np.float16),
            rain.seed_of(seed, frame.location, frame.view, frame.weather),
        )
        passes.A, passes.B = rain.over_gain(passes.A, drops), rain.over(passes.B, drops)
    passes.image_linear = passes.A * srgb_to_linear(np.array(REFERENCE) / 255) + passes.B
    return passes
