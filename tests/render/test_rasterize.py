"""What the rasterizer shows: the right samples, whatever the pattern, and where they lie."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stability.rasterizer import at_depth_one, flat
from rauca_core.contract import RaucaError
from rauca_core.render import rasterize
from rauca_core.render.raster.pattern import pattern
from rauca_core.render.surface import find_surface


def inside(points: np.ndarray, x: float, y: float) -> bool:
    corners = points[:, :2]
    along, there = np.roll(corners, -1, axis=0) - corners, np.array([x, y]) - corners
    signs = along[:, 0] * there[:, 1] - along[:, 1] * there[:, 0]
    return all(s > 0 for s in signs) or all(s < 0 for s in signs)


@pytest.mark.parametrize("samples", range(2, 17))
def test_rows_that_read_the_texture_are_spread_as_evenly_as_all(samples: int) -> None:
    chosen = pattern(samples)
    assert chosen.stride == (1 if samples < 12 else 2)
    assert chosen.number >= samples**2
    for points in (chosen.points(), chosen.points()[:: chosen.stride]):
        apart = points[:, None] - points[None]
        apart -= np.rint(apart)
        squared = np.where(np.eye(len(points)) > 0, np.inf, (apart**2).sum(2))
        assert squared.min() * len(points) > 1 - 1e-9  # as a square grid
    assert chosen.side**2 * len(points) == pytest.approx(1)


def test_window_is_a_crop_of_the_whole_image() -> None:
    points = at_depth_one([(5.2, 6.1), (9.7, 6.9), (7.0, 11.3)])
    raster = rasterize(points, np.array([[0, 1, 2]]), flat(16), 4)
    rows, columns = np.nonzero(raster.face_ids >= 0)
    assert raster.face_ids.shape[0] < 7 * raster.pattern.rows
    assert raster.face_ids.shape[1] < 8 * raster.pattern.columns
    seen = raster.points(rows, columns)
    assert all(inside(points, x, y) for x, y in seen)
    homogeneous = np.pad(seen, ((0, 0), (0, 1)), constant_values=1.0)
    back = find_surface(raster, np.ones(1, bool)).barycentrics @ points
    assert np.allclose(back, homogeneous, atol=1e-9)


def test_margin_shows_what_lies_just_outside() -> None:
    points = at_depth_one([(-3, -3), (3, -3), (-3, 3)])
    raster = rasterize(points, np.array([(0, 1, 2)]), flat(8), samples=2, margin=1)
    assert (raster.x0, raster.y0) == (0, 0)  # a pixel before the image begins
    assert raster.face_ids[0, 0] == 0
    assert np.allclose(raster.points(np.array([0]), np.array([0])), raster.pattern.points()[0] - 1)


def test_absurd_sizes_are_refused() -> None:
    corner = at_depth_one([(0, 0), (1, 0), (0, 1)]), np.array([(0, 1, 2)])
    with pytest.raises(RaucaError, match="samples"):
        rasterize(*corner, flat(8), 17)
    with pytest.raises(RaucaError, match="16386"):
        rasterize(*corner, flat(16384), margin=1)
    wanted = (pattern(16).points().sum(1) < 1).sum()
    assert (rasterize(*corner, flat(16384), 16).face_ids == 0).sum() == wanted


@pytest.mark.parametrize("face", [(0, 1, 3), (0, 1, -1)])
def test_a_vertex_that_does_not_exist_is_named(face: tuple[int, int, int]) -> None:
    with pytest.raises(RaucaError, match="outside 0 to 2"):
        rasterize(at_depth_one([(0, 0), (1, 0), (0, 1)]), np.array([face]), flat(8))
