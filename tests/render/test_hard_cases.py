"""Every row of the hard-case table, on every path of the rasteriser.

Where the table's other rows are tested, all in `test_taps.py`:

- UV outside [0, 1], UV-degenerate faces: ``test_uv_outside_the_map_and_degenerate_uv_stay_finite``, and here
  ``test_uv_outside_the_map_reads_its_border`` and ``test_a_face_without_uv_area_reads_one_constant``
- seams and gutters: ``test_no_colour_bleeds_from_gutters``
- grazing angles: ``test_error_falls_with_samples``
- empty mask: ``test_view_without_paint_has_no_taps_and_no_gradient``, and here ``test_an_empty_mask_is_refused``
- fp16 and bf16 gradients: ``test_half_precision_gradients_accumulate_in_float32``
- adjointness, row sums: ``test_adjoint_is_exact``, ``test_constant_texture_gives_its_colour_times_alpha``
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import torch

from rauca_core.contract import Camera, RaucaError, Vehicle
from rauca_core.render import Pyramid, build_taps, rasterize

PATHS = [None, "cpu"] + (["cuda"] if torch.cuda.is_available() else [])


@pytest.fixture(params=PATHS, ids=lambda path: f"torch-{path}" if path else "compiled")
def render(request: pytest.FixtureRequest) -> Any:
    return partial(rasterize, device=request.param)


def flat(size: int) -> Camera:
    """Image coordinates are world coordinates at depth 1."""
    return Camera(np.eye(3), np.eye(3), np.zeros(3), size, size)


def at_depth_one(points: Any) -> np.ndarray:
    return np.pad(np.asarray(points, float), ((0, 0), (0, 1)), constant_values=1.0)


def triangulated(inner: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """A square cut into triangles at random points inside it; corners of it first."""
    points = np.concatenate([[(0, 0), (size, 0), (size, size), (0, size)], np.unique(inner, axis=0)])
    faces = [(0, 1, 2), (0, 2, 3)]
    for n in np.random.default_rng(0).permutation(np.arange(4, len(points))):
        for face in list(faces):
            edges = [(face[k], face[(k + 1) % 3]) for k in range(3)]
            sides = [np.linalg.det([points[b] - points[a], points[n] - points[a]]) for a, b in edges]
            if min(sides) > -1e-9:
                faces.remove(face)
                faces += [(a, b, int(n)) for (a, b), side in zip(edges, sides, strict=True) if side > 1e-9]
    return points, np.array(faces)


def owners(render: Any, points: np.ndarray, faces: Any, size: int, samples: int = 1) -> np.ndarray:
    """How many of the faces own each sample, when every face is drawn alone."""
    return np.sum([render(points, np.array([f]), flat(size), samples).whole(size, size) >= 0 for f in faces], 0)


@pytest.mark.parametrize("diagonal", [[(0, 1, 2), (0, 2, 3)], [(0, 1, 3), (1, 2, 3)]])
def test_a_diagonal_through_sample_centres_is_owned_once(render: Any, diagonal: list[tuple[int, int, int]]) -> None:
    square = at_depth_one([(0.5, 0.5), (32.5, 0.5), (32.5, 32.5), (0.5, 32.5)])
    number = owners(render, square, diagonal, 40)
    assert (number[:32, :32] == 1).all()
    assert number.sum() == 1024  # top and left edges own their samples, bottom and right ones do not


def test_a_triangulation_with_vertices_on_centres_has_no_hole_and_no_double(render: Any) -> None:
    rng = np.random.default_rng(0)
    points, faces = triangulated(rng.integers(0, 16, (40, 2)) + 0.5, 16)
    for samples in (1, 4):
        assert (owners(render, at_depth_one(points), faces, 16, samples) == 1).all()
    turned = np.array([f[:: rng.choice([-1, 1])] for f in faces])  # either winding
    assert (owners(render, at_depth_one(points), turned, 16) == 1).all()


def test_faces_without_area_draw_nothing(render: Any) -> None:
    points = at_depth_one([(1.5, 1.5), (20.5, 20.5), (39.5, 39.5), (1.5, 1.5), (10, 30)])
    # A needle through sample centres, two equal corners, a repeated index, a point.
    faces = np.array([(0, 1, 2), (0, 3, 4), (0, 0, 4), (4, 4, 4)])
    raster = render(points, faces, flat(40), 4)
    assert (raster.face_ids == -1).all()
    assert np.isfinite(raster.planes).all()


def test_a_needle_is_finite(render: Any) -> None:
    points = at_depth_one([(1.5, 1.5), (39.5, 1.5 + 1e-4), (39.5, 1.5 - 1e-4)]) * [[1], [2], [3]]
    raster = render(points, np.array([(0, 1, 2)]), flat(40), 4)
    assert np.isfinite(raster.barycentrics()).all()
    assert np.isfinite(raster.planes).all()


def test_a_nan_vertex_drops_its_faces_and_is_counted(render: Any) -> None:
    points = at_depth_one([(0, 0), (8, 0), (8, 8), (0, 8), (4, 4)])
    points[3, 1], points[4, 0] = np.nan, np.inf
    with pytest.warns(UserWarning, match="2 vertices are NaN"):
        ids = render(points, np.array([(0, 1, 2), (0, 2, 3), (0, 1, 4)]), flat(8)).whole(8, 8)
    assert (ids[np.triu_indices(8, 1)] == 0).all()
    assert (ids[np.tril_indices(8, -1)] == -1).all()


def test_tiny_faces_leave_no_gap(render: Any) -> None:
    steps = np.linspace(0, 24, 301)
    x, y = np.meshgrid(steps, steps)
    n = np.arange(300 * 301).reshape(300, 301)[:, :300].ravel()
    faces = np.concatenate([np.stack([n, n + 1, n + 302], 1), np.stack([n, n + 302, n + 301], 1)])
    assert len(faces) == 180_000
    ids = render(at_depth_one(np.stack([x.ravel(), y.ravel()], 1)), faces, flat(24)).whole(24, 24)
    assert ids.size == 576
    assert (ids >= 0).all()


@pytest.mark.parametrize("far", [4e6, 1e10, 1e25])
def test_huge_coordinates_cover_the_image(render: Any, far: float) -> None:
    points = at_depth_one([(-far, -far), (far, -far), (far, far), (-far, far)])
    raster = render(points, np.array([(0, 1, 2), (0, 2, 3)]), flat(32), 2)
    assert (raster.whole(32, 32) >= 0).all()
    assert np.isfinite(raster.barycentrics()).all()
    assert (owners(render, points, [(0, 1, 2), (0, 2, 3)], 32) == 1).all()


def test_the_ground_through_the_camera_fills_the_lower_half(render: Any) -> None:
    camera = Camera.look_at(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0]), 90, 64, 64)
    ground = np.array([(-1e4, -1e4, 0), (1e4, -1e4, 0), (1e4, 1e4, 0), (-1e4, 1e4, 0)], float)
    faces = np.array([(0, 1, 2), (0, 2, 3)])
    raster = render(ground, faces, camera, 2)
    ids, horizon = raster.whole(64, 64), 32 * raster.pattern.rows
    assert (ids[horizon + 2 :] >= 0).all()
    assert (ids[: horizon - 2] == -1).all()
    rows, columns = np.nonzero(raster.face_ids >= 0)
    found = raster.barycentrics()[rows, columns, None] @ ground[faces[raster.face_ids[rows, columns]]]
    near = found[:, 0, 0] < 100
    assert np.abs(camera.project(found[:, 0])[0] - raster.points(rows, columns))[near].max() < 1e-6


def test_a_camera_inside_a_box_sees_it_everywhere(render: Any) -> None:
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    for aim in [(1.0, 0.7, 0.3), (-1.0, 0.2, -0.9), (0.1, 0.2, 1.0)]:
        camera = Camera.look_at(np.array([0.1, 0.2, 0.0]), np.array(aim), 100, 48, 48)
        assert (render(corners, faces, camera).whole(48, 48) >= 0).all()


def test_a_face_behind_the_camera_is_not_mirrored_into_view(render: Any) -> None:
    camera = Camera.look_at(np.zeros(3), np.array([1.0, 0, 0]), 60, 16, 16)
    behind = np.array([(-2, -1, -1), (-2, 1, -1), (-2, 0, 1)], float)
    assert render(behind, np.array([(0, 1, 2)]), camera).face_ids.size == 0


def test_what_is_nearer_than_the_near_plane_is_cut_off(render: Any) -> None:
    camera = Camera.look_at(np.zeros(3), np.array([1.0, 0, 0]), 90, 16, 16)
    points = np.array([(0.01, -1, -1), (0.01, 1, -1), (0.01, 0, 2), (0.03, -1, -1), (0.03, 1, -1), (0.03, 0, 2)])
    faces = np.array([(0, 1, 2), (3, 4, 5)])
    assert (render(points, faces, camera).whole(16, 16) == 1).all()
    assert (render(points, faces, camera, near=0.005).whole(16, 16) == 0).all()


def test_the_lowest_of_coplanar_duplicates_wins(render: Any) -> None:
    camera = Camera.look_at(np.array([10.0, 0.3, 0.2]), np.zeros(3), 30, 32, 32)
    sheet = np.array([(0, -1, -1), (0, 1, -1), (0, 0, 1)], float)
    for turned in [(0, 1, 2), (1, 2, 0), (2, 1, 0)]:
        ids = render(sheet, np.array([turned, (0, 1, 2), turned]), camera).whole(32, 32)
        assert set(np.unique(ids)) == {-1, 0}


def test_the_nearer_face_wins_by_a_micrometre(render: Any) -> None:
    camera = Camera.look_at(np.array([10.0, 0.3, 0.2]), np.zeros(3), 30, 32, 32)
    sheet = np.array([(0, -1, -1), (0, 1, -1), (0, 0, 1)], float)
    points = np.concatenate([sheet, sheet + np.array([1e-6, 0, 0])])
    for order in ([(0, 1, 2), (3, 4, 5)], [(3, 4, 5), (0, 1, 2)]):
        ids = render(points, np.array(order), camera).whole(32, 32)
        assert set(np.unique(ids)) == {-1, order.index((3, 4, 5))}


def test_ties_are_settled_in_the_order_of_faces(render: Any) -> None:
    # Each sheet is nearer than the last by less than a tie: the first stays until one beats it by more than that.
    sheets = [at_depth_one([(0, 0), (8, 0), (0, 8)]) / (1 + 0.6e-9 * n) for n in range(6)]
    ids = render(np.concatenate(sheets), np.arange(18).reshape(6, 3), flat(8)).whole(8, 8)
    assert set(np.unique(ids)) == {-1, 4}  # 0 gives way to 2, and 2 to 4


def test_uv_outside_the_map_reads_its_border(box_vehicle: Vehicle) -> None:
    camera = Camera.look_at(np.array([0.0, -6.0, 0.7]), np.array([0.0, 0.0, 0.7]), 40, 32, 32)
    mask = np.full_like(box_vehicle.paint_mask, 255)
    uvs = box_vehicle.uvs.copy()
    uvs[:2, :, 0] += 7.0  # the wall that the camera faces
    pyramid = Pyramid.of(replace(box_vehicle, paint_mask=mask), 64)
    uv_map = torch.zeros(3, 64, 64)
    uv_map[:, :, -8:] = 1.0
    moved = replace(box_vehicle, uvs=uvs, paint_mask=mask)
    taps = build_taps(moved, camera, 64, pyramid=pyramid)
    inside = taps.alpha > 0.99
    assert inside.sum() > 100
    assert np.isfinite(taps.rows.weights).all()
    seen = taps.rows(pyramid(pyramid.from_map(uv_map)))[torch.from_numpy(inside)]
    assert torch.allclose(seen, torch.ones_like(seen), atol=1e-5)


def test_a_face_without_uv_area_reads_one_constant(box_vehicle: Vehicle) -> None:
    camera = Camera.look_at(np.array([0.0, -6.0, 0.7]), np.array([0.0, 0.0, 0.7]), 40, 32, 32)
    pyramid = Pyramid.of(box_vehicle, 64)
    box_vehicle.uvs[:2] = 0.25
    taps = build_taps(box_vehicle, camera, 64, pyramid=pyramid)
    texels = torch.rand(len(pyramid.texels), 3, generator=torch.Generator().manual_seed(0))
    seen = taps.rows(pyramid(texels))
    assert len(seen) > 100
    assert torch.allclose(seen, seen[:1].expand_as(seen), atol=1e-5)


def test_an_empty_mask_is_refused(box_vehicle: Vehicle) -> None:
    camera = Camera.look_at(np.array([0.0, -6.0, 0.7]), np.array([0.0, 0.0, 0.7]), 40, 32, 32)
    bare = replace(box_vehicle, paint_mask=np.zeros_like(box_vehicle.paint_mask))
    with pytest.raises(RaucaError, match="paint"):
        build_taps(bare, camera, 64)
