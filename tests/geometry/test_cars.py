"""The procedural cars: lamps at the right ends, round tyres and two like sides."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.geometry.car import CARS, read_profile


@pytest.fixture(params=CARS)
def car(request, build):
    return build(request.param)


def faces_of(car, name: str) -> np.ndarray:
    """(F, 3, 3) corners of a material's faces."""
    index = [m.name for m in car.materials].index(name)
    return car.positions[car.triangles[car.material == index]].astype(np.float64)


def test_lamps_are_at_their_ends_and_dark_by_day(car):
    half = car.size()[0] / 2
    assert faces_of(car, "headlamp")[..., 0].mean() > 0.75 * half
    assert faces_of(car, "taillamp")[..., 0].mean() < -0.75 * half
    assert abs(faces_of(car, "headlamp")[..., 1].mean()) < 1e-2
    assert all(m.emission == 0.0 for m in car.materials)


def test_tyres_enclose_a_positive_volume(car):
    wheels = read_profile(car.name)["wheels"]
    corners = faces_of(car, "tyre")
    hubs = np.array([[x, y, wheels["radius"]] for x in (wheels["front_x"], wheels["rear_x"]) for y in (-1, 1)])
    hubs[:, 1] *= wheels["half_track"]
    nearest = np.linalg.norm(corners.mean(axis=1)[:, None] - hubs, axis=2).argmin(axis=1)
    corners -= hubs[nearest][:, None]
    volume = np.einsum("ni,ni->n", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert (np.bincount(nearest, volume) > 0.5 * np.pi * wheels["radius"] ** 2 * wheels["width"] * 0.5).all()


def test_left_and_right_mirror_each_other(car):
    ink = [m.name for m in car.materials].index("ink")  # the plates' characters do not mirror
    faces = car.triangles[car.material != ink]
    points = {tuple(p) for p in np.round(car.positions[faces].reshape(-1, 3) * 2**16).astype(int).tolist()}
    assert all((x, -y, z) in points for x, y, z in points)


def test_classes_differ_where_real_ones_do(build):
    cars = {name: build(name) for name in CARS}
    sills = {name: min(read_profile(name)["wall"]["row_sill"]) for name in CARS}
    paint = {name: car.positions[car.triangles[car.paint_faces()]].reshape(-1, 3) for name, car in cars.items()}
    assert sills["suv"] > 1.25 * sills["sedan"]
    assert cars["van"].size()[2] > 1.1 * cars["suv"].size()[2] > 1.1 * 1.1 * cars["sedan"].size()[2]
    for name, (low, high) in {"sedan": (0, 0.76), "hatchback": (0.78, 0.88), "suv": (0.9, 1), "van": (0.97, 1)}.items():
        # How high the body still is at a tenth of its length from the tail: a boot, a sloping hatch, a box.
        tail = paint[name][:, 0] < paint[name][:, 0].min() + 0.1 * cars[name].size()[0]
        assert low < paint[name][tail][:, 2].max() / paint[name][:, 2].max() < high
