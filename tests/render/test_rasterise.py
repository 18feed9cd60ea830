"""Hard cases of the rasteriser; most break one published renderer or another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rauca_core.contract import Camera, RaucaError
from rauca_core.render import rasterize
from rauca_core.render.pattern import pattern
from rauca_core.render.rasterise import Raster


def flat(size: int) -> Camera:
    """Image coordinates are world coordinates at depth 1."""
    return Camera(np.eye(3), np.eye(3), np.zeros(3), size, size)


def full(raster: Raster, size: int) -> np.ndarray:
    """The window put back into the whole image."""
    grid = np.full((size * raster.pattern.rows, size * raster.pattern.columns), -1)
    height, width = raster.face_ids.shape
    grid[raster.y0 : raster.y0 + height, raster.x0 : raster.x0 + width] = raster.face_ids
    return grid


def at_depth_one(points: list[tuple[float, float]]) -> np.ndarray:
    return np.array([(x, y, 1.0) for x, y in points])


def inside(points: np.ndarray, x: float, y: float) -> bool:
    signs = [np.cross(points[(k + 1) % 3, :2] - points[k, :2], np.array([x, y]) - points[k, :2]) for k in range(3)]
    return all(s > 0 for s in signs) or all(s < 0 for s in signs)


@pytest.mark.parametrize(("samples", "kind"), [(1, "grid"), (3, "grid"), (2, "lattice"), (3, "lattice")])
def test_samples_agree_with_a_point_in_triangle_test(samples: int, kind: str) -> None:
    rng = np.random.default_rng(1)
    chosen = pattern(samples, kind)
    for _ in range(10):
        points = at_depth_one([tuple(p) for p in rng.uniform(-5, 25, (3, 2))])
        ids = full(rasterize(points, np.array([[0, 1, 2]]), flat(20), pattern=chosen), 20)
        rows = ids.reshape(20, chosen.rows, 20, chosen.columns).transpose(0, 2, 1, 3).reshape(400, -1)
        corners = np.stack(np.divmod(np.arange(400), 20)[::-1], 1)
        wanted = [[inside(points, *(corner + place)) for place in chosen.points()] for corner in corners]
        assert (ids >= 0).sum() > 0
        assert ((rows >= 0) != np.array(wanted)).sum() <= 1  # snapping may move an edge over a sample


@pytest.mark.parametrize(("samples", "kind"), [(16, "lattice"), (3, "grid"), (2, "lattice")])
def test_patterns_agree_with_one_sample_of_a_shifted_image(samples: int, kind: str) -> None:
    rng = np.random.default_rng(3)
    points = np.concatenate([rng.uniform(-2, 10, (30, 2)), np.ones((30, 1))], 1) * rng.uniform(1, 3, (30, 1))
    faces, chosen = np.arange(30).reshape(10, 3), pattern(samples, kind)
    ids = full(rasterize(points, faces, flat(8), pattern=chosen), 8)
    assert (ids >= 0).any()
    for n, (x, y) in list(enumerate(chosen.points()))[:: max(1, chosen.number // 9)]:
        moved = np.array([[1, 0, 0.5 - x], [0, 1, 0.5 - y], [0, 0, 1]])
        one = full(rasterize(points, faces, replace(flat(8), K=moved)), 8)
        row, column = divmod(n, chosen.columns)
        assert (ids[row :: chosen.rows, column :: chosen.columns] != one).sum() <= 1


def test_window_is_a_crop_of_the_whole_image() -> None:
    points = at_depth_one([(5.2, 6.1), (9.7, 6.9), (7.0, 11.3)])
    raster = rasterize(points, np.array([[0, 1, 2]]), flat(16), 4)
    rows, columns = np.nonzero(raster.face_ids >= 0)
    assert raster.face_ids.shape[0] < 7 * raster.pattern.rows
    assert raster.face_ids.shape[1] < 8 * raster.pattern.columns
    seen = raster.points(rows, columns)
    assert all(inside(points, x, y) for x, y in seen)
    homogeneous = np.pad(seen, ((0, 0), (0, 1)), constant_values=1.0)
    back = raster.barycentrics()[rows, columns] @ points
    assert np.allclose(back, homogeneous, atol=1e-9)


@pytest.mark.parametrize("diagonal", [[(0, 1, 2), (0, 2, 3)], [(0, 1, 3), (1, 2, 3)]])
def test_diagonal_through_pixel_centres_is_owned_once(diagonal: list[tuple[int, int, int]]) -> None:
    square = at_depth_one([(0.5, 0.5), (40.5, 0.5), (40.5, 40.5), (0.5, 40.5)])
    one, two = (full(rasterize(square, np.array([t]), flat(64)), 64) >= 0 for t in diagonal)
    assert not (one & two).any()
    assert (one | two)[:40, :40].all()
    assert (one | two).sum() == 40 * 40  # top and left edges own their centres, bottom and right do not


def test_fan_with_vertices_on_centres_has_no_hole() -> None:
    rng = np.random.default_rng(2)
    inner = rng.integers(5, 59, (40, 2)) + 0.5
    for centre in inner:
        corners = at_depth_one([(0, 0), (64, 0), (64, 64), (0, 64), tuple(centre)])
        faces = np.array([(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
        each = [full(rasterize(corners, faces[k : k + 1], flat(64)), 64) >= 0 for k in range(4)]
        assert (np.sum(each, 0) == 1).all()


def test_faces_without_area_draw_nothing() -> None:
    points = at_depth_one([(1, 1), (20, 20), (39, 39), (1, 1), (10, 30)])
    faces = np.array([(0, 1, 2), (0, 3, 4), (0, 0, 4), (4, 4, 4)])  # needle, zero area, repeated indices
    assert (full(rasterize(points, faces, flat(40), 4), 40) == -1).all()


def test_tiny_faces_leave_no_gap() -> None:
    steps = np.linspace(0, 24, 301)
    x, y = np.meshgrid(steps, steps)
    points = np.stack([x.ravel(), y.ravel(), np.ones(x.size)], 1)
    n = np.arange(300 * 301).reshape(300, 301)[:, :300].ravel()
    faces = np.concatenate([np.stack([n, n + 1, n + 302], 1), np.stack([n, n + 302, n + 301], 1)])
    assert len(faces) == 180_000
    assert (full(rasterize(points, faces, flat(24)), 24) >= 0).all()


def test_nan_vertex_drops_its_faces_and_is_counted() -> None:
    points = at_depth_one([(0, 0), (8, 0), (8, 8), (0, 8)])
    points[3, 1] = np.nan
    with pytest.warns(UserWarning, match="1 vertices are NaN"):
        ids = full(rasterize(points, np.array([(0, 1, 2), (0, 2, 3)]), flat(8)), 8)
    assert (ids[np.triu_indices(8, 1)] == 0).all()
    assert (ids[np.tril_indices(8, -1)] == -1).all()


@pytest.mark.parametrize("far", [4e6, 1e10])
def test_huge_coordinates_cover_the_image(far: float) -> None:
    points = at_depth_one([(-far, -far), (far, -far), (far, far), (-far, far)])
    raster = rasterize(points, np.array([(0, 1, 2), (0, 2, 3)]), flat(32), 2)
    assert (full(raster, 32) >= 0).all()
    assert np.isfinite(raster.barycentrics()).all()


def test_ground_plane_through_the_camera_fills_the_lower_half() -> None:
    camera = Camera.look_at(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0]), 90, 64, 64)
    ground = np.array([(-1e4, -1e4, 0), (1e4, -1e4, 0), (1e4, 1e4, 0), (-1e4, 1e4, 0)], float)
    raster = rasterize(ground, np.array([(0, 1, 2), (0, 2, 3)]), camera, 2)
    ids = full(raster, 64)
    horizon = 32 * raster.pattern.rows
    assert (ids[horizon + 2 :] >= 0).all()
    assert (ids[: horizon - 2] == -1).all()
    rows, columns = np.nonzero(raster.face_ids >= 0)
    points = np.einsum(
        "nk,nkc->nc",
        raster.barycentrics()[rows, columns],
        ground[np.array([(0, 1, 2), (0, 2, 3)])[raster.face_ids[rows, columns]]],
    )
    pixels, _ = camera.project(points)
    near = points[:, 0] < 100
    assert np.abs(pixels - raster.points(rows, columns))[near].max() < 1e-6


def test_camera_inside_a_box_sees_it_everywhere() -> None:
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    camera = Camera.look_at(np.array([0.1, 0.2, 0.0]), np.array([1.0, 0.7, 0.3]), 100, 48, 48)
    assert (full(rasterize(corners, faces, camera), 48) >= 0).all()


def test_nearer_face_wins_by_a_micrometre_and_ties_go_to_the_lowest_id() -> None:
    camera = Camera.look_at(np.array([10.0, 0.3, 0.2]), np.zeros(3), 30, 32, 32)
    sheet = np.array([(0, -1, -1), (0, 1, -1), (0, 0, 1)], float)
    points = np.concatenate([sheet, sheet + np.array([1e-6, 0, 0])])
    ids = full(rasterize(points, np.array([(0, 1, 2), (3, 4, 5)]), camera), 32)
    assert set(np.unique(ids)) == {-1, 1}
    for turned in [(0, 1, 2), (1, 2, 0), (2, 1, 0)]:
        ids = full(rasterize(sheet, np.array([(0, 1, 2), turned]), camera), 32)
        assert set(np.unique(ids)) == {-1, 0}


def test_a_face_behind_the_camera_is_not_mirrored_into_view() -> None:
    camera = Camera.look_at(np.zeros(3), np.array([1.0, 0, 0]), 60, 16, 16)
    behind = np.array([(-2, -1, -1), (-2, 1, -1), (-2, 0, 1)], float)
    assert rasterize(behind, np.array([(0, 1, 2)]), camera).face_ids.size == 0


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
