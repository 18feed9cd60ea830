"""Meshes that are hard to rasterize; the precision is that of the vertices."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from rauca_core.contract import Camera
from rauca_core.render import Raster, rasterize
from rauca_core.render.surface import find_surface

from . import Checks, expect

Points = NDArray[np.floating]
NO_HALF = {torch.bfloat16: "vertices are never bfloat16: those of a car would move by 8 mm"}
SHEET = [(0, -1, -1), (0, 1, -1), (0, 0, 1)]
QUAD = [(0, 1, 2), (0, 2, 3)]
CHECKS = Checks("rasterizer", lambda dtype: np.float64 if dtype == torch.float64 else np.float32, NO_HALF)


def flat(size: int) -> Camera:
    """Image coordinates are world coordinates at depth 1."""
    return Camera(np.eye(3), np.eye(3), np.zeros(3), size, size)


def at_depth_one(points: Any, kind: Any = np.float64) -> Points:
    """(N, 2) pixels -> (N, 3) vertices."""
    return np.pad(np.asarray(points, float), ((0, 0), (0, 1)), constant_values=1.0).astype(kind)


def owners(points: Points, faces: Any, size: int, samples: int = 1) -> NDArray[np.integer]:
    """How many of the faces (F, 3), each drawn alone, own a sample."""
    return np.sum([rasterize(points, np.array([f]), flat(size), samples).whole(size, size) >= 0 for f in faces], 0)


def triangulated(inner: Points, size: int) -> tuple[Points, NDArray[np.integer]]:
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


def _once(number: NDArray[np.integer]) -> None:
    holes, doubles = int((number == 0).sum()), int((number > 1).sum())
    expect(holes == doubles == 0, f"{holes} samples without a face, {doubles} with two")


@CHECKS.case("diagonal through sample centers", "every sample owned by one face")
def _diagonal(kind: Any) -> None:
    square = at_depth_one([(0.5, 0.5), (32.5, 0.5), (32.5, 32.5), (0.5, 32.5)], kind)
    for faces in (QUAD, [(0, 1, 3), (1, 2, 3)]):
        number = owners(square, faces, 40)
        # Top and left edges own their samples, bottom and right ones do not.
        expect(number.sum() == 1024, f"{number.sum()} samples inside, not 1024")
        _once(number[:32, :32])


@CHECKS.case("vertices on sample centers", "every sample owned by one face, either winding")
def _vertices_on_centers(kind: Any) -> None:
    rng = np.random.default_rng(0)
    points, faces = triangulated(rng.integers(0, 16, (40, 2)) + 0.5, 16)
    turned = np.array([f[:: rng.choice([-1, 1])] for f in faces])  # either winding
    for order, samples in ((turned, 1), (faces, 1), (faces, 4)):
        _once(owners(at_depth_one(points, kind), order, 16, samples))


@CHECKS.case("faces without area", "nothing drawn, all finite")
def _without_area(kind: Any) -> None:
    points = at_depth_one([(1.5, 1.5), (20.5, 20.5), (39.5, 39.5), (1.5, 1.5), (10, 30)], kind)
    # A needle through sample centers, two equal corners, a repeated index, a point.
    raster = rasterize(points, np.array([(0, 1, 2), (0, 3, 4), (0, 0, 4), (4, 4, 4)]), flat(40), 4)
    drawn = int((raster.face_ids >= 0).sum())
    expect(drawn == 0, f"{drawn} samples drawn")
    expect(np.isfinite(raster.planes).all(), "planes are not finite")


@CHECKS.case("a needle in perspective", "all finite")
def _needle(kind: Any) -> None:
    points = at_depth_one([(1.5, 1.5), (39.5, 1.5 + 1e-4), (39.5, 1.5 - 1e-4)]) * [[1], [2], [3]]
    raster = rasterize(points.astype(kind), np.array([(0, 1, 2)]), flat(40), 4)
    expect(np.isfinite(_barycentrics(raster)).all(), "barycentrics are not finite")
    expect(np.isfinite(raster.planes).all(), "planes are not finite")


@CHECKS.case("NaN and infinite vertices", "their faces left out, with a warning that counts")
def _nan_vertex(kind: Any) -> None:
    points = at_depth_one([(0, 0), (8, 0), (8, 8), (0, 8), (4, 4)], kind)
    points[3, 1], points[4, 0] = np.nan, np.inf
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        ids = rasterize(points, np.array([(0, 1, 2), (0, 2, 3), (0, 1, 4)]), flat(8)).whole(8, 8)
    expect(any("2 vertices are NaN" in str(w.message) for w in told), "no warning that counts the vertices")
    expect((ids[np.triu_indices(8, 1)] == 0).all(), "the sound face is missing")
    expect((ids[np.tril_indices(8, -1)] == -1).all(), "a broken face is drawn")


@CHECKS.case("faces smaller than a sample", "no gap")
def _tiny_faces(kind: Any) -> None:
    x, y = np.meshgrid(np.linspace(0, 24, 301), np.linspace(0, 24, 301))
    n = np.arange(300 * 301).reshape(300, 301)[:, :300].ravel()
    faces = np.concatenate([np.stack([n, n + 1, n + 302], 1), np.stack([n, n + 302, n + 301], 1)])
    ids = rasterize(at_depth_one(np.stack([x.ravel(), y.ravel()], 1), kind), faces, flat(24)).whole(24, 24)
    expect((ids >= 0).all(), f"{(ids < 0).sum()} gaps")


@CHECKS.case("coordinates up to 1e25", "the image covered, every sample owned by one face")
def _huge_coordinates(kind: Any) -> None:
    for far in (4e6, 1e10, 1e25):
        points = at_depth_one([(-far, -far), (far, -far), (far, far), (-far, far)], kind)
        raster = rasterize(points, np.array(QUAD), flat(32), 2)
        expect((raster.whole(32, 32) >= 0).all(), f"gaps at {far:.0e}")
        expect(np.isfinite(_barycentrics(raster)).all(), f"barycentrics are not finite at {far:.0e}")
        _once(owners(points, QUAD, 32))


@CHECKS.case("ground through the camera", "the lower half filled, all finite")
def _ground_through_the_camera(kind: Any) -> None:
    camera = Camera.look_at(np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0]), 90, 64, 64)
    ground = np.array([(-1e4, -1e4, 0), (1e4, -1e4, 0), (1e4, 1e4, 0), (-1e4, 1e4, 0)], kind)
    faces = np.array(QUAD)
    raster = rasterize(ground, faces, camera, 2)
    ids, horizon = raster.whole(64, 64), 32 * raster.pattern.rows
    expect((ids[horizon + 2 :] >= 0).all(), "gaps below the horizon")
    expect((ids[: horizon - 2] == -1).all(), "ground above the horizon")
    rows, columns = np.nonzero(raster.face_ids >= 0)
    found = _barycentrics(raster)[:, None] @ ground[faces[raster.face_ids[rows, columns]]]
    near = found[:, 0, 0] < 100
    off = float(np.abs(camera.project(found[:, 0])[0] - raster.points(rows, columns))[near].max())
    expect(off < 1e-6, f"points lie {off:.1e} pixels beside their samples")


@CHECKS.case("camera inside a box", "a face everywhere")
def _inside_a_box(kind: Any) -> None:
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], kind)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    for aim in [(1.0, 0.7, 0.3), (-1.0, 0.2, -0.9), (0.1, 0.2, 1.0)]:
        camera = Camera.look_at(np.array([0.1, 0.2, 0.0]), np.array(aim), 100, 48, 48)
        gaps = int((rasterize(corners, faces, camera).whole(48, 48) < 0).sum())
        expect(gaps == 0, f"{gaps} gaps towards {aim}")


@CHECKS.case("face behind the camera", "not mirrored into view")
def _behind_the_camera(kind: Any) -> None:
    camera = Camera.look_at(np.zeros(3), np.array([1.0, 0, 0]), 60, 16, 16)
    behind = np.array([(-2, -1, -1), (-2, 1, -1), (-2, 0, 1)], kind)
    expect(rasterize(behind, np.array([(0, 1, 2)]), camera).face_ids.size == 0, "mirrored into view")


@CHECKS.case("nearer than the near plane", "cut off")
def _near_plane(kind: Any) -> None:
    camera = Camera.look_at(np.zeros(3), np.array([1.0, 0, 0]), 90, 16, 16)
    points = np.array([(0.01, -1, -1), (0.01, 1, -1), (0.01, 0, 2), (0.03, -1, -1), (0.03, 1, -1), (0.03, 0, 2)], kind)
    faces = np.array([(0, 1, 2), (3, 4, 5)])
    expect((rasterize(points, faces, camera).whole(16, 16) == 1).all(), "a face before the near plane is drawn")
    expect((rasterize(points, faces, camera, near=0.005).whole(16, 16) == 0).all(), "a face behind it is not")


@CHECKS.case("coplanar duplicates", "the lowest face wins, however it is turned")
def _coplanar_duplicates(kind: Any) -> None:
    for turned in [(0, 1, 2), (1, 2, 0), (2, 1, 0)]:
        seen = _seen(np.array(SHEET, kind), [turned, (0, 1, 2), turned])
        expect(seen == {0}, f"faces {sorted(seen)} seen")


@CHECKS.case("a micrometre apart at 10 m", "the nearer face wins")
def _micrometre(kind: Any) -> None:
    points = np.concatenate([SHEET, np.add(SHEET, (1e-6, 0, 0))]).astype(kind)
    for order in ([(0, 1, 2), (3, 4, 5)], [(3, 4, 5), (0, 1, 2)]):
        seen = _seen(points, order)
        expect(seen == {order.index((3, 4, 5))}, f"faces {sorted(seen)} seen")


@CHECKS.case("ties in depth", "settled in the order of faces: sheet 4 of 6, or 0 where rounding makes them one")
def _ties(kind: Any) -> str:
    # Each sheet is nearer than the last by less than a tie: the first stays until one beats it by more than that.
    sheets = [at_depth_one([(0, 0), (8, 0), (0, 8)]) / (1 + 0.6e-9 * n) for n in range(6)]
    points = np.concatenate(sheets).astype(kind)
    ids = rasterize(points, np.arange(18).reshape(6, 3), flat(8)).whole(8, 8)
    # 0 gives way to 2, and 2 to 4. As float32 all six are one sheet.
    wanted = 4 if kind is np.float64 else 0
    expect(set(np.unique(ids)) == {-1, wanted}, f"faces {set(np.unique(ids))} seen")
    return f"sheet {wanted} everywhere"


def _barycentrics(raster: Raster) -> Points:
    """Of every sample that sees a face (N, 3), row by row."""
    return find_surface(raster, np.ones(len(raster.triangles), bool)).barycentrics


def _seen(points: Points, faces: Sequence[Any]) -> set[int]:
    """The faces that are seen at all, from ten metres."""
    camera = Camera.look_at(np.array([10.0, 0.3, 0.2]), np.zeros(3), 30, 32, 32)
    return set(np.unique(rasterize(points, np.array(faces), camera).whole(32, 32)).tolist()) - {-1}
