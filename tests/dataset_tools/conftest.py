"""A whole data set in miniature: the box in the ring's cameras, lit by numpy, with a truck in one view."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rauca_core.contract import (
    Dataset,
    Frame,
    FramePasses,
    LedgerEntry,
    Plan,
    PlannedFrame,
    Quality,
    Ring,
    Vehicle,
    Weather,
    append_entry,
    claim_folder,
    planned_frames,
    save_frame,
    seal_dataset,
)
from rauca_core.contract.color import check_color, recolor, srgb_to_linear
from rauca_core.contract.semantics import CLASS_IDS, find_instances, mask_box
from rauca_core.contract.viewpoints import viewpoint
from rauca_core.render import rasterize

SIZE = 48
GREY = (140, 140, 140)
POSE = np.array([[0.0, -1, 0, 3], [1, 0, 0, -2], [0, 0, 1, 0], [0, 0, 0, 1]])
TRUCK = 9


def a_plan(vehicle: Vehicle) -> Plan:
    ring = Ring((30.0, 200.0), (15.0,), (7.0,), jitter_azimuth_deg=8, jitter_distance=0.1, jitter_roll_deg=3)
    return Plan(
        "mini", "box", vehicle.atlas_id, SIZE, Quality(1), True, (Weather("day", 45.0), Weather("dusk", 5.0)), ring,
        1, GREY, 0.5, 0, "none", recolor_share=0.6,
    )  # fmt: skip


def render(vehicle: Vehicle, plan: Plan, planned: PlannedFrame) -> tuple[Frame, FramePasses]:
    """A frame as the real ones are: Lambert light on the box, sky above grass, a truck at the left of view 0."""
    center = ((vehicle.positions.min(axis=0) + vehicle.positions.max(axis=0)) / 2).astype(np.float64)
    seen_by = viewpoint(plan, planned.location, planned.view, POSE, center)
    faces = rasterize(vehicle.positions, vehicle.triangles, seen_by.camera.relative_to(POSE)).whole(SIZE, SIZE)
    seen = faces >= 0
    paint = seen & vehicle.paint_faces()[faces]
    light = np.abs(vehicle.normals.mean(axis=1) @ [0.3, 0.5, 0.8]) * (1.0 if planned.weather.name == "day" else 0.3)
    A, B = np.zeros((SIZE, SIZE, 3), np.float32), np.full((SIZE, SIZE, 3), 0.3, np.float32)
    semantic = np.full((SIZE, SIZE), CLASS_IDS["sky"], np.uint8)
    instances, distance = np.zeros((SIZE, SIZE), np.uint8), np.full((SIZE, SIZE), np.inf, np.float32)
    B[SIZE // 2 :], semantic[SIZE // 2 :], distance[SIZE // 2 :] = 0.1, CLASS_IDS["terrain"], 20.0
    if planned.view == 0:
        B[18:30, :5], semantic[18:30, :5], instances[18:30, :5] = 0.2, CLASS_IDS["other_vehicle"], TRUCK
        distance[18:30, :5] = 15.0
    A[paint], B[seen], instances[seen], distance[seen] = light[faces[paint], None], 0.02, 255, 7.0
    semantic[seen] = np.where(paint[seen], CLASS_IDS["paint"], CLASS_IDS["vehicle_part"])
    checked = check_color(plan.seed, plan.recolor_share, planned.id)
    frame = Frame(
        planned.id, planned.location, planned.view, seen_by.camera, POSE, planned.weather, seen_by.azimuth_deg,
        seen_by.elevation_deg, seen_by.distance_m, mask_box(seen), 1.0, 1, find_instances(instances, {TRUCK: "truck"}),
        checked,
    )  # fmt: skip
    noise = np.random.default_rng(planned.view).normal(0, 0.002, B.shape)
    real = None if checked is None else recolor(A, B, checked) + noise.astype(np.float32)
    image = A * srgb_to_linear(np.array(GREY) / 255) + B
    coverage = (seen.astype(np.float32), paint.astype(np.float32))
    return frame, FramePasses(image, *coverage, distance, A, B, semantic, instances, real)


@pytest.fixture
def make_mini(box_vehicle: Vehicle) -> Callable[[Path], Dataset]:
    def make(folder: Path) -> Dataset:
        plan = a_plan(box_vehicle)
        box_vehicle.save(folder / "vehicle")
        claim_folder(folder, plan)
        seal_dataset(folder)
        for planned in planned_frames(plan):
            save_frame(folder / "frames" / planned.id, *render(box_vehicle, plan, planned))
            append_entry(folder, LedgerEntry(planned.id, "done", 1.0))
        return Dataset(folder)

    return make


@pytest.fixture
def mini(tmp_path: Path, make_mini: Callable[[Path], Dataset]) -> Dataset:
    return make_mini(tmp_path / "mini")
