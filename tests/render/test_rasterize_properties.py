"""Random meshes before random cameras: every path sees the same, and every sample has one owner."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from rauca_core.contract import Camera
from rauca_core.render import rasterize
from rauca_core.render.raster import rasterize_torch
from rauca_core.render.raster.pattern import pattern

DEVICES = ["cpu"] + (["cuda"] if torch.cuda.is_available() else [])
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


@pytest.mark.parametrize("device", DEVICES)
@settings(max_examples=250)
@given(
    mesh=meshes(),
    camera=cameras(),
    samples=st.integers(1, 4),
    kind=st.sampled_from(["lattice", "grid"]),
    margin=st.integers(0, 1),
    chunk=st.sampled_from([1, 200, 2**22]),
)
def test_paths_see_the_same_faces(
    device: str, mesh: Any, camera: Camera, samples: int, kind: str, margin: int, chunk: int
) -> None:
    with warnings.catch_warnings(), pytest.MonkeyPatch.context() as patch:
        warnings.simplefilter("ignore", UserWarning)
        patch.setattr(rasterize_torch, "CHUNK", chunk)
        chosen = pattern(samples, kind)
        compiled = rasterize(*mesh, camera, margin=margin, pattern=chosen)
        plain = rasterize(*mesh, camera, margin=margin, pattern=chosen, device=device)
    assert (compiled.x0, compiled.y0, compiled.face_ids.shape) == (plain.x0, plain.y0, plain.face_ids.shape)
    assert (compiled.face_ids == plain.face_ids).all()
    assert np.isfinite(compiled.barycentrics()).all()


@pytest.mark.parametrize("device", DEVICES)
@settings(max_examples=50)
@given(st.lists(st.integers(0, 3), min_size=1, max_size=40), st.lists(st.booleans(), min_size=40, max_size=40))
def test_paths_settle_stacks_of_ties_alike(device: str, steps: list[int], turned: list[bool]) -> None:
    sheet = np.array([(0, 0, 1), (6, 0, 1), (0, 6, 1)], float)
    stack = np.concatenate([sheet / (1 + 0.4e-9 * n) for n in np.cumsum(np.array(steps) - 1)])
    faces = np.arange(len(stack)).reshape(-1, 3)
    faces = np.array([f[::-1] if t else f for f, t in zip(faces, turned, strict=False)])
    camera = Camera(np.eye(3), np.eye(3), np.zeros(3), 6, 6)
    assert (rasterize(stack, faces, camera).face_ids == rasterize(stack, faces, camera, device=device).face_ids).all()


def triangulated(inner: list[tuple[int, int]], size: int) -> tuple[np.ndarray, np.ndarray]:
    """A square from -size to size cut into triangles at integer points inside it."""
    points = [(-size, -size), (size, -size), (size, size), (-size, size), *dict.fromkeys(inner)]
    faces = [(0, 1, 2), (0, 2, 3)]
    for n in range(4, len(points)):
        for face in list(faces):
            edges = [(face[k], face[(k + 1) % 3]) for k in range(3)]
            sides = [_side(points[a], points[b], points[n]) for a, b in edges]
            if min(sides) >= 0:
                faces.remove(face)
                faces += [(a, b, n) for (a, b), side in zip(edges, sides, strict=True) if side > 0]
    return np.array(points, float), np.array(faces)


def _side(a: tuple[int, int], b: tuple[int, int], c: tuple[int, int]) -> int:
    return (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])


def owners(points: np.ndarray, faces: np.ndarray, camera: Camera, samples: int) -> np.ndarray:
    """How many of the faces own each sample, when every face is drawn alone."""
    alone = [rasterize(points, f[None], camera, samples).whole(camera.width, camera.height) >= 0 for f in faces]
    return np.sum(alone, 0)


CELLS = st.integers(-31, 31)


@settings(max_examples=60)
@given(st.lists(st.tuples(CELLS, CELLS), max_size=25), st.integers(1, 4))
@example([(0, 0), (1, 1), (3, 3)], 1)
def test_a_partition_owns_each_sample_once(inner: list[tuple[int, int]], samples: int) -> None:
    points, faces = triangulated(inner, 32)
    flat = np.pad(points / 4 + 8, ((0, 0), (0, 1)), constant_values=1.0)  # vertices on centers, edges and quarters
    camera = Camera(np.eye(3), np.eye(3), np.zeros(3), 16, 16)
    assert (owners(flat, faces, camera, samples) == 1).all()


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
    points, faces = triangulated(inner, 32)  # some vertices lie behind the camera
    ground = np.pad(points, ((0, 0), (0, 1)))
    camera = Camera.look_at(np.array(eye), np.array([eye[0] + lean, eye[1], eye[2] - 1]), 100, 16, 16, roll)
    assert (owners(ground, faces, camera, 2) == 1).all()
