"""Random meshes before random cameras: what is seen is what brute force sees, and every sample has one owner."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from benchmarks.stability.rasterizer import at_depth_one, owners, triangulated
from rauca_core.contract import Camera
from rauca_core.render import rasterize
from rauca_core.render.raster.pattern import Pattern, pattern
from rauca_core.render.surface import find_surface

LATTICE = st.integers(-12, 12).map(lambda n: n / 4)
COORDINATES = st.one_of(
    LATTICE,
    st.floats(-4, 4),
    st.sampled_from([0.0, -0.0, 1e-300, 1e6, -4e6, 1e10, -1e25, 1e35, float("nan"), float("inf")]),
)
EYES = st.one_of(st.tuples(LATTICE, LATTICE, LATTICE), st.tuples(*[st.floats(-3, 3)] * 3))


@st.composite
def meshes(draw: Any, coordinates: Any = COORDINATES) -> tuple[np.ndarray, np.ndarray]:
    """A few vertices, some of them twice, joined at random: repeated corners and duplicate faces among them."""
    vertices = draw(st.lists(st.tuples(*[coordinates] * 3), min_size=3, max_size=10))
    index = st.integers(0, len(vertices) - 1)
    faces = draw(st.lists(st.tuples(index, index, index), max_size=16))
    again = draw(st.lists(st.sampled_from(faces), max_size=4)) if faces else []
    positions = np.array(vertices, np.float32 if draw(st.booleans()) else np.float64)
    return positions, np.array(faces + again, np.int32).reshape(-1, 3)


@st.composite
def cameras(draw: Any) -> Camera:
    eye, target = np.array(draw(EYES)), np.array(draw(EYES))
    if np.linalg.norm(eye - target) < 1e-3:
        target = eye + 1.0
    width, height = draw(st.integers(1, 24)), draw(st.integers(1, 24))
    return Camera.look_at(eye, target, draw(st.floats(20, 150)), width, height, draw(st.floats(-180, 180)))


ONE, LIMIT, TIE, GUARD, NEAR = 65536, 1e30, 1.0 + 1e-9, 4096, 0.02


def brute_force(positions: np.ndarray, faces: np.ndarray, camera: Camera, chosen: Pattern, margin: int) -> np.ndarray:
    """Face ids of all samples, margin included: every triangle asks every sample, in integers, at its owner's depth."""
    width, height = camera.width + 2 * margin, camera.height + 2 * margin
    r, c = np.arange(height * chosen.rows) - margin * chosen.rows, np.arange(width * chosen.columns)
    c -= margin * chosen.columns
    shifts = np.rint(chosen.shifts * ONE).astype(np.int64)[r % chosen.rows]
    y = ((r * ONE + ONE // 2) // chosen.rows)[:, None]
    x = (c * ONE + shifts[:, None]) // chosen.columns
    lefts, tops = (shifts / (ONE * chosen.columns))[:, None], ((r + 0.5) / chosen.rows)[:, None]
    m = camera.K @ np.column_stack([camera.R, camera.t])
    p = positions.astype(np.float64)
    points = np.stack([m[n, 0] * p[:, 0] + m[n, 1] * p[:, 1] + m[n, 2] * p[:, 2] + m[n, 3] for n in range(3)], 1)
    ids, nearest = np.full(x.shape, -1), np.zeros(x.shape)
    for face, corners in enumerate(points[faces]):
        if not (np.abs(corners) <= LIMIT).all():
            continue
        a, b, d = corners[0], corners[1] - corners[0], corners[2] - corners[0]
        normal = np.array([b[n - 2] * d[n - 1] - b[n - 1] * d[n - 2] for n in range(3)])
        plane = normal * (1.0 / (a[0] * normal[0] + a[1] * normal[1] + a[2] * normal[2]))
        if not abs(plane[0]) + abs(plane[1]) + abs(plane[2]) <= LIMIT:
            continue
        depth = plane[0] / chosen.columns * c + (plane[0] * lefts + (plane[1] * tops + plane[2]))
        polygon = clip(list(corners), camera, GUARD + margin)
        over = [1.0 / max(q[2], NEAR) for q in polygon]
        snapped = [np.rint(q[:2] * o * ONE).astype(np.int64) for q, o in zip(polygon, over, strict=True)]
        for n in range(1, len(polygon) - 1):
            fan = [0, n, n + 1]
            value = np.clip(depth, min(over[k] for k in fan), max(over[k] for k in fan))
            shown = covered([snapped[k] for k in fan], x, y) & (value > nearest)
            ids[shown], nearest[shown] = face, value[shown] * TIE
    return ids


def clip(polygon: list[np.ndarray], camera: Camera, guard: float) -> list[np.ndarray]:
    """Sutherland-Hodgman at the near plane and a guard band, each cut from the end nearer to the plane."""
    planes = [(0, 0, 1), (1, 0, guard), (-1, 0, camera.width + guard), (0, 1, guard), (0, -1, camera.height + guard)]
    for plane in planes:
        offset = NEAR if plane == (0, 0, 1) else 0.0
        sides = [plane[0] * q[0] + plane[1] * q[1] + plane[2] * q[2] - offset for q in polygon]
        kept = []
        for n, (here, d_here) in enumerate(zip(polygon, sides, strict=True)):
            there, d_there = polygon[(n + 1) % len(polygon)], sides[(n + 1) % len(polygon)]
            if d_here >= 0:
                kept.append(here)
            if (d_here >= 0) != (d_there >= 0):
                if abs(d_here) < abs(d_there) or (d_here >= 0 and d_here == -d_there):
                    kept.append(here + d_here / (d_here - d_there) * (there - here))
                else:
                    kept.append(there + d_there / (d_there - d_here) * (here - there))
        polygon = kept
        if len(polygon) < 3:
            return []
    return polygon


def covered(corners: list[np.ndarray], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Samples that a triangle owns by the top-left rule."""
    a, b, c = corners
    area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
    inside = np.full(x.shape, area != 0)
    for start, end in ((a, b), (b, c), (c, a)) if area > 0 else ((a, c), (c, b), (b, a)):
        dx, dy = end - start
        owns = dy < 0 or (dy == 0 and dx > 0)
        inside &= dx * (y - start[1]) - dy * (x - start[0]) >= (0 if owns else 1)
    return inside


@settings(max_examples=250)
@given(
    mesh=meshes(),
    camera=cameras(),
    samples=st.integers(1, 4),
    kind=st.sampled_from(["lattice", "grid"]),
    margin=st.integers(0, 1),
)
def test_brute_force_sees_the_same_faces(mesh: Any, camera: Camera, samples: int, kind: str, margin: int) -> None:
    chosen = pattern(samples, kind)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", UserWarning)
        raster = rasterize(*mesh, camera, margin=margin, pattern=chosen)
        wanted = brute_force(*mesh, camera, chosen, margin)
    window = wanted[raster.y0 :, raster.x0 :][: raster.face_ids.shape[0], : raster.face_ids.shape[1]]
    assert (raster.face_ids == window).all()
    assert (window >= 0).sum() == (wanted >= 0).sum()
    assert np.isfinite(find_surface(raster, np.ones(len(raster.triangles), bool)).barycentrics).all()


CELLS = st.integers(1, 63)


@settings(max_examples=60)
@given(st.lists(st.tuples(CELLS, CELLS), max_size=25), st.integers(1, 4))
@example([(32, 32), (33, 33), (35, 35)], 1)
def test_a_partition_owns_each_sample_once(inner: list[tuple[int, int]], samples: int) -> None:
    points, faces = triangulated(np.array(inner).reshape(-1, 2), 64)
    corners = at_depth_one(points / 4)  # vertices on centers, edges and quarters
    assert (owners(corners, faces, 16, samples) == 1).all()


@settings(max_examples=40)
@given(
    st.lists(st.tuples(CELLS, CELLS), max_size=20),
    st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.3, 3)),
    st.floats(-0.5, 0.5),
    st.floats(-180, 180),
)
def test_the_ground_under_a_camera_is_owned_once(
    inner: list[tuple[int, int]], eye: tuple[float, float, float], lean: float, roll: float
) -> None:
    points, faces = triangulated(np.array(inner).reshape(-1, 2), 64)  # some vertices lie behind the camera
    ground = np.pad(2 * points - 64.0, ((0, 0), (0, 1)))  # far enough: from 3 m up the flattest ray meets it after 42 m
    camera = Camera.look_at(np.array(eye), np.array([eye[0] + lean, eye[1], eye[2] - 1]), 100, 16, 16, roll)
    owned = np.sum([rasterize(ground, face[None], camera, 2).whole(16, 16) >= 0 for face in faces], 0)
    assert (owned == 1).all()
