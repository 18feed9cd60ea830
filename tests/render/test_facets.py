"""Algorithms 1 and 2 as operators against the printed loops, forward and backward; the benchmark's Algorithm 2 too."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from benchmarks.algorithm2 import texel_faces, uv_traversal_step, uv_traversal_step_back
from rauca_core.contract import Camera, RaucaError, Vehicle
from rauca_core.render import Pyramid, SparseOperator, rasterize
from rauca_core.render.facets import check_texture_size, onto_pyramid, tensor_traversal, uv_traversal
from rauca_core.render.sampler import Sampler, facet_operator, look_up
from rauca_core.render.sparse import compose, from_triplets
from rauca_core.render.surface import find_surface

SIZE = 9
CASES = [(seed, ts) for seed in range(3) for ts in (2, 3, 4)]


def faces_in_the_map(seed: int) -> np.ndarray:
    """Random UV triangles: of both windings, overlapping, one degenerate, one partly and one wholly off the map."""
    uvs = np.random.default_rng(seed).uniform(0, 1, (7, 3, 2))
    uvs[1, 1], uvs[1, 2] = uvs[1, 2].copy(), uvs[1, 1].copy()
    uvs[3] = uvs[3, :1]
    uvs[4] = uvs[4] * 2 - 0.4
    uvs[5] += 3.0
    areas = np.linalg.det(uvs[:, 1:] - uvs[:, :1])
    assert (areas > 1e-3).any()
    assert (areas < -1e-3).any()
    return uvs


def at(uv_map: Tensor, column: int, row: int) -> Tensor:
    return uv_map[min(max(row, 0), SIZE - 1), min(max(column, 0), SIZE - 1)]


def algorithm_1(uv_map: Tensor, uvs: np.ndarray, ts: int) -> Tensor:
    """The paper's Algorithm 1, line by line; UV[column, row] is uv_map[row, column]."""
    cells = []
    for m in range(len(uvs)):
        for x in range(ts):
            for y in range(ts):
                for z in range(ts):
                    w = np.array([x, y, z]) / (ts - 1)
                    if w.sum() > 0:
                        w = w / w.sum()
                    u, v = w @ uvs[m]
                    a = min(max(u * SIZE - 0.5, 0.0), SIZE - 1.0)
                    b = min(max((1 - v) * SIZE - 0.5, 0.0), SIZE - 1.0)
                    fa, fb = math.floor(a), math.floor(b)
                    color = torch.zeros(3, dtype=uv_map.dtype)
                    for p in ((fa, fb), (fa + 1, fb), (fa, fb + 1), (fa + 1, fb + 1)):
                        color = color + (1 - abs(p[0] - a)) * (1 - abs(p[1] - b)) * at(uv_map, *p)
                    cells.append(color)
    return torch.stack(cells)


def algorithm_2(uv_map: Tensor, uvs: np.ndarray, ts: int) -> Tensor:
    """The paper's Algorithm 2, line by line."""
    cells: dict[tuple[int, ...], Tensor] = {}
    total: dict[tuple[int, ...], float] = {}
    for x in range(SIZE):
        for y in range(SIZE):
            found = owner(np.array([(x + 0.5) / SIZE, 1 - (y + 0.5) / SIZE]), uvs)
            if found is None:
                continue
            m, barycentrics = found
            a, b, c = barycentrics * (ts - 1)
            fa, fb, fc = math.floor(a), math.floor(b), math.floor(c)
            for i in range(8):
                p = (fa + i // 4, fb + i // 2 % 2, fc + i % 2)
                w = (1 - abs(p[0] - a)) * (1 - abs(p[1] - b)) * (1 - abs(p[2] - c))
                total[m, *p] = total.get((m, *p), 0.0) + w
                cells[m, *p] = cells.get((m, *p), torch.zeros(3, dtype=uv_map.dtype)) + w * uv_map[y, x]
    black = torch.zeros(3, dtype=uv_map.dtype)
    places = [(m, x, y, z) for m in range(len(uvs)) for x in range(ts) for y in range(ts) for z in range(ts)]
    return torch.stack([cells[p] / total[p] if total.get(p, 0) > 0 else black for p in places])


def owner(point: np.ndarray, uvs: np.ndarray) -> tuple[int, np.ndarray] | None:
    for m, corners in enumerate(uvs):
        matrix = np.stack([corners[1] - corners[0], corners[2] - corners[0]], 1)
        if abs(np.linalg.det(matrix)) > 1e-12:
            b, c = np.linalg.solve(matrix, point - corners[0])
            if min(b, c, 1 - b - c) >= 0:
                return m, np.array([1 - b - c, b, c])
    return None


def random_map(seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(SIZE, SIZE, 3, dtype=torch.float64, generator=generator).requires_grad_()


@pytest.mark.parametrize(("seed", "ts"), CASES)
@pytest.mark.parametrize("number", [1, 2])
def test_operators_are_the_printed_algorithms(number: int, seed: int, ts: int) -> None:
    uvs, uv_map = faces_in_the_map(seed), random_map(seed)
    loop, build = ((algorithm_1, tensor_traversal), (algorithm_2, uv_traversal))[number - 1]
    operator = build(uvs, SIZE, ts, np.float64)
    wanted = loop(uv_map, uvs, ts)
    found = operator(uv_map.reshape(-1, 3))
    assert torch.allclose(found, wanted, rtol=0, atol=1e-10)
    gradient = torch.randn(wanted.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(seed + 9))
    slopes = [torch.autograd.grad((image * gradient).sum(), uv_map)[0] for image in (wanted, found)]
    assert torch.allclose(*slopes, rtol=0, atol=1e-10)


@pytest.mark.parametrize(("seed", "ts"), CASES)
def test_the_benchmarks_step_is_the_operator(seed: int, ts: int) -> None:
    uvs, uv_map = faces_in_the_map(seed), random_map(seed).detach().numpy()
    gradient = np.random.default_rng(seed).normal(size=(len(uvs), ts, ts, ts, 3))
    operator, faces = uv_traversal(uvs, SIZE, ts, np.float64), texel_faces(uvs, SIZE)
    cells, total = uv_traversal_step(uv_map, uvs, faces, ts)
    texels = torch.from_numpy(uv_map.reshape(-1, 3)).requires_grad_()
    wanted = operator(texels)
    assert np.allclose(cells.reshape(-1, 3), wanted.detach(), rtol=0, atol=1e-10)
    back = uv_traversal_step_back(gradient, total, uvs, faces)
    wanted.backward(torch.from_numpy(gradient.reshape(-1, 3)))
    assert np.allclose(back.reshape(-1, 3), texels.grad, rtol=0, atol=1e-10)
    assert ((total > 0).ravel() == (np.diff(operator.indptr) > 0)).all()
    assert (total == 0).any()


def test_lowest_face_owns_texels_under_two_charts() -> None:
    whole = np.array([[-1.0, 0.0], [2.0, 0.0], [0.5, 3.0]])
    assert (texel_faces(np.stack([whole, whole]), SIZE) == 0).all()
    assert (texel_faces(np.stack([whole + 9, whole]), SIZE) == 1).all()


def test_cells_of_chosen_faces_are_the_same_rows() -> None:
    uvs = faces_in_the_map(1)
    every, some = uv_traversal(uvs, SIZE, 3), uv_traversal(uvs, SIZE, 3, faces=np.array([2, 6]))
    x = torch.rand(SIZE * SIZE, 3)
    assert torch.equal(every(x).reshape(len(uvs), -1, 3)[[2, 6]], some(x).reshape(2, -1, 3))


def test_a_texture_size_of_one_is_refused() -> None:
    with pytest.raises(RaucaError, match="texture size: 1"):
        tensor_traversal(faces_in_the_map(0), SIZE, 1)
    with pytest.raises(RaucaError, match="2\\^31"):
        check_texture_size(10**8, 6)


def test_product_applies_one_operator_after_the_other() -> None:
    generator = np.random.default_rng(0)

    def operator(rows: int, columns: int) -> SparseOperator:
        places = [generator.integers(0, n, 40) for n in (rows, columns)]
        return from_triplets(*places, generator.normal(size=40), (rows, columns), np.float64)

    outer, inner = operator(11, 8), operator(8, 13)
    both = compose(outer, inner)
    x = torch.randn(13, 3, dtype=torch.float64)
    assert torch.allclose(both(x), outer(inner(x)), atol=1e-12)
    pairs = list(zip(np.repeat(np.arange(11), np.diff(both.indptr)), both.columns, strict=True))
    assert pairs == sorted(set(pairs))  # merged and in order
    with pytest.raises(RaucaError, match="compose"):
        compose(inner, outer)


def test_gutters_are_dropped(box_vehicle: Vehicle) -> None:
    box_vehicle.paint_mask[:, 15:] = 0  # through the middle of two charts
    pyramid = Pyramid.of(box_vehicle, 64)
    for build in (tensor_traversal, uv_traversal):
        whole = build(box_vehicle.uvs[:8], 64, 3)
        inside = onto_pyramid(whole, pyramid)
        kept, before = np.diff(inside.indptr), np.diff(whole.indptr)
        assert ((kept > 0) & (kept < before)).any()  # some cells lean over the edge of the paint
        cells = inside(torch.full((pyramid.count, 3), 0.25))
        assert torch.allclose(cells[kept > 0], torch.tensor(0.25), atol=1e-6)
        assert (kept > 0).sum() > 40


@pytest.mark.parametrize("sampler", [Sampler.TENSOR_TRAVERSAL, Sampler.UV_TRAVERSAL])
def test_pixels_read_the_tensor_as_neural_renderer(box_vehicle: Vehicle, sampler: Sampler) -> None:
    ts, size = 4, 64
    camera = Camera.look_at(np.array([5.0, 3.5, 2.0]), np.array([0.0, 0.0, 0.7]), 50, 24, 20)
    raster = rasterize(box_vehicle.positions, box_vehicle.triangles, camera)
    pyramid = Pyramid.of(box_vehicle, size)
    found = look_up(box_vehicle, raster, pyramid, sampler, ts)
    assert found.inner is not None
    texels = torch.rand(pyramid.count, 3, dtype=torch.float64)
    tensor = facet_operator(box_vehicle, pyramid, sampler, ts)(texels).reshape(8, ts, ts, ts, 3)
    local = found.inner(texels)
    surface = find_surface(raster, box_vehicle.paint_faces())
    assert len(surface.faces) == len(found.paint) > 50
    for n in range(0, len(surface.faces), 5):
        point, color = surface.barycentrics[n] * (ts - 1), torch.zeros(3, dtype=torch.float64)
        for i in range(8):
            p = [min(int(point[k]), ts - 2) + (i >> k) % 2 for k in range(3)]
            color = color + math.prod(1 - abs(p[k] - point[k]) for k in range(3)) * tensor[surface.faces[n], *p]
        weights = torch.from_numpy(found.weights[n]).double()
        read = weights @ local[torch.from_numpy(found.texels[n]).long()]
        assert torch.allclose(read, color, atol=1e-6)
