"""A small data set of drawn cars: a detector takes them for cars, and no renderer is needed."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rauca_core.contract import (
    Camera,
    Camouflage,
    Dataset,
    FramePasses,
    Ring,
    Vehicle,
    Weather,
    claim_folder,
    save_camouflage,
    save_frame,
)
from rauca_core.contract.color import linear_to_srgb, to_bytes
from rauca_core.contract.files import png_bytes, write_bytes
from rauca_core.detect import Detector, load_detector
from tests.contract.samples import PLAN, a_frame
from tests.published import published_weights

torch.set_num_threads(1)  # small images: more threads only get in each other's way

SIZE = 192
GREY = (0.25, 0.27, 0.3)
NOISE = (float("nan"),) * 3
WEATHERS = (Weather("clear-day", 45), Weather("low-sun", 10), Weather("fog", 45, fog_density=90))
RING = Ring((0.0, 90.0, 180.0, 270.0), (10.0,), (6.0, 9.0))


@dataclass(frozen=True)
class Scene:
    """A small data set, a folder of renders of the same frames in another paint, and that paint's camouflage."""

    dataset: Dataset
    noise: Path
    camouflage: Path


@pytest.fixture(scope="session")
def detectors() -> list[Detector]:
    return [load_detector(name, SIZE) for name in published_weights("yolov4-tiny", "yolov2-tiny")]


@pytest.fixture
def scene(tmp_path: Path, box_vehicle: Vehicle) -> Scene:
    folder = tmp_path / "dataset"
    plan = replace(
        PLAN,
        name="drawn",
        atlas_id=box_vehicle.atlas_id,
        size=SIZE,
        light=False,
        weathers=WEATHERS,
        ring=RING,
        locations=1,
    )
    claim_folder(folder, plan)
    box_vehicle.save(folder / "vehicle")
    dataset = Dataset(folder)
    for number, (frame_id, _, view, weather) in enumerate(plan.frames()):
        _draw_frame(dataset, frame_id, view, weather, number, tmp_path / "noise")
    camouflage = Camouflage("noise", "box", box_vehicle.atlas_id, 64, "random")
    pixels = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    save_camouflage(tmp_path / "noise.json", camouflage, png_bytes(pixels))
    return Scene(dataset, tmp_path / "noise", tmp_path / "noise.json")


def _draw_frame(dataset: Dataset, frame_id: str, view: int, weather: Weather, number: int, noise: Path) -> None:
    azimuth, elevation, distance = dataset.plan.ring.nominal(view)
    length = 1000 / distance
    where = {"size": SIZE, "left": (SIZE - length) / 2, "ground": 140.0, "length": length, "seed": number}
    haze = weather.fog_density / 100
    image, coverage, box = draw_car(**where, paint=GREY, haze=haze)
    camouflaged, _, _ = draw_car(**where, paint=NOISE, haze=haze)
    hidden = number == 5  # as if something stood before the vehicle
    frame = a_frame(
        id=frame_id,
        view=view,
        camera=Camera.look_at(np.array([distance, 0, 1.0]), np.zeros(3), 60, SIZE, SIZE),
        weather=weather,
        azimuth_deg=azimuth + 0.5,
        elevation_deg=elevation - 0.5,
        distance_m=distance + 0.1,
        box_xyxy=None if hidden else box,
    )
    passes = FramePasses(image, coverage, coverage, np.full((SIZE, SIZE), distance, np.float32))
    save_frame(dataset.frame_folder(frame_id), frame, passes)
    write_bytes(noise / f"{frame_id}.png", png_bytes(to_bytes(linear_to_srgb(camouflaged))))


# Outline of a sedan's left side, front at the left: x right, y up, in units of its length.
BODY = [
    (0.0, 0.09), (0.01, 0.17), (0.06, 0.2), (0.25, 0.225), (0.36, 0.31), (0.5, 0.335), (0.64, 0.325), (0.8, 0.235),
    (0.96, 0.22), (0.995, 0.17), (1.0, 0.09), (0.97, 0.07), (0.03, 0.07),
]  # fmt: skip
WINDOWS = [
    [(0.28, 0.225), (0.375, 0.297), (0.475, 0.317), (0.475, 0.225)],
    [(0.49, 0.225), (0.49, 0.318), (0.63, 0.308), (0.73, 0.235), (0.72, 0.225)],
]
WHEELS = (0.19, 0.79)


@functools.cache
def draw_car(
    size: int,
    left: float,
    ground: float,
    length: float,
    paint: tuple[float, float, float],
    seed: int,
    haze: float = 0.0,
) -> tuple[NDArray[np.float32], NDArray[np.float32], tuple[float, float, float, float]]:
    """A car in a street.

    Args:
        left, ground, length: where its front and its tyres are and how long it is, pixels.
        paint: linear RGB; NaN paints noise instead.
        haze: 0 to 1, how much of everything is white.

    Returns:
        (size, size, 3) linear image, (size, size) coverage of the car, xyxy box.
    """
    rng = np.random.default_rng(seed)
    over = 4  # drawn larger, then averaged: soft edges as a renderer makes them
    scale, n = length * over, size * over

    def points(outline: list[tuple[float, float]]) -> NDArray[np.int32]:
        return np.array([(left * over + x * scale, ground * over - y * scale) for x, y in outline]).round().astype(int)

    image = np.empty((n, n, 3), np.float32)
    horizon = int(0.45 * n)
    image[:horizon] = np.linspace(0.45, 0.75, horizon)[:, None, None] * np.array([0.6, 0.8, 1.0])
    image[horizon:] = np.linspace(0.2, 0.13, n - horizon)[:, None, None] * np.array([1.0, 0.97, 0.93])
    image *= rng.uniform(0.93, 1.07, (n // over, n // over, 1)).repeat(over, 0).repeat(over, 1)
    mask = np.zeros((n, n), np.uint8)
    cv2.fillPoly(mask, [points(BODY)], 255)
    color = np.array(paint, np.float32)
    cells = rng.random((24, 24, 3)).astype(np.float32) ** 2
    noise = cv2.resize(cells, (n, n), interpolation=cv2.INTER_NEAREST) if np.isnan(color).any() else color
    shade = np.interp(np.arange(n), [ground * over - 0.34 * scale, ground * over - 0.07 * scale], [1.25, 0.55])
    shadow = np.zeros((n, n), np.float32)
    center = (int(left * over + scale / 2), int(ground * over))
    cv2.ellipse(shadow, center, (int(0.55 * scale), int(0.035 * scale)), 0, 0, 360, 1.0, -1)
    image *= 1 - 0.85 * cv2.GaussianBlur(shadow, (0, 0), 0.01 * scale)[..., None]
    image = np.where(mask[..., None] > 0, noise * shade[:, None, None], image).astype(np.float32)
    for window in WINDOWS:
        cv2.fillPoly(image, [points(window)], (0.03, 0.04, 0.05))
    for x in WHEELS:
        hub = tuple(int(v) for v in points([(x, 0.075)])[0])
        for radius, grey in ((0.085, 0.01), (0.072, 0.015), (0.047, 0.35), (0.04, 0.12), (0.012, 0.4)):
            cv2.circle(image, hub, int(radius * scale), (grey,) * 3, -1)
        cv2.circle(mask, hub, int(0.072 * scale), 255, -1)
    cv2.fillPoly(image, [points([(0.01, 0.15), (0.02, 0.18), (0.09, 0.185), (0.07, 0.155)])], (0.8, 0.8, 0.75))
    cv2.fillPoly(image, [points([(0.99, 0.16), (0.985, 0.2), (0.93, 0.205), (0.94, 0.17)])], (0.4, 0.02, 0.02))
    for x in (0.483, 0.3, 0.71):
        cv2.line(image, *map(tuple, points([(x, 0.1), (x, 0.225)]).tolist()), (0.02, 0.02, 0.02), max(1, over // 2))
    image = (1 - haze) * image + haze * 0.8
    small = cv2.resize(image, (size, size), interpolation=cv2.INTER_AREA)
    coverage = cv2.resize(mask.astype(np.float32) / 255, (size, size), interpolation=cv2.INTER_AREA)
    rows, columns = np.nonzero(coverage.max(1) > 0.5)[0], np.nonzero(coverage.max(0) > 0.5)[0]
    box = (float(columns[0]), float(rows[0]), float(columns[-1] + 1), float(rows[-1] + 1))
    return small, coverage, box


@pytest.fixture(scope="session")
def nutnet_learnt(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The defence NutNet has learnt smooth pictures, for a tenth of its usual steps."""
    from rauca_core.study.defences import nutnet
    from tests.study.test_defences_informed import picture

    folder = tmp_path_factory.mktemp("nutnet")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nutnet, "weights_folder", lambda: folder)
        patch.setattr(nutnet, "STEPS", 150)
        nutnet.train([picture(seed)[0, :, :28] for seed in range(4)])  # above the square of texture
        yield folder
