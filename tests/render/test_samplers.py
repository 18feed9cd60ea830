"""What the samplers of other renderers read, against the lookups they stand for."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import torch.nn.functional as torch_functional

from rauca_core.contract import Camera, Vehicle
from rauca_core.render import Pyramid, rasterize
from rauca_core.render.lookup import Fragments, read_level
from rauca_core.render.raster.rasterize import Raster
from rauca_core.render.sampler import Sampler, look_up
from rauca_core.render.surface import find_surface, mask_at

SIZE = 64


@pytest.fixture
def whole_box(box_vehicle: Vehicle) -> Vehicle:
    """The box with all of its charts paintable."""
    box_vehicle.paint_mask[:] = 255
    return box_vehicle


def view(vehicle: Vehicle, distance: float = 1.0, samples: int = 1) -> Raster:
    eye = np.array([5.0, 3.5, 2.0]) * distance
    camera = Camera.look_at(eye, np.array([0.0, 0.0, 0.7]), 50 / distance, 40, 32)
    return rasterize(vehicle.positions, vehicle.triangles, camera, samples)


def colors(found: Fragments, texels: np.ndarray) -> np.ndarray:
    """Color (N, 3) of every fragment."""
    values = torch.from_numpy(texels)
    listed = (found.inner(values) if found.inner else values).numpy()
    return np.einsum("nk,nkc->nc", found.weights, listed[found.texels])


@pytest.mark.parametrize("sampler", list(Sampler))
@pytest.mark.parametrize("distance", [1.0, 12.0])
def test_constant_texture_keeps_its_color(box_vehicle: Vehicle, sampler: Sampler, distance: float) -> None:
    raster, pyramid = view(box_vehicle, distance), Pyramid.of(box_vehicle, SIZE)
    found = look_up(box_vehicle, raster, pyramid, sampler, 4)
    assert found.columns == (found.inner.shape[0] if found.inner else pyramid.count)
    assert found.texels.min() >= 0
    assert found.texels.max() < found.columns
    assert (found.weights >= 0).all()
    assert np.allclose(found.weights.sum(1), 1, atol=1e-5)
    seen = (raster.face_ids >= 0) & (raster.face_ids < 8)
    assert ((found.index >= 0) == seen).all()
    read = colors(found, np.full((pyramid.count, 3), 0.25))
    inner = found.paint > 0.999
    assert inner.sum() > 100
    assert np.allclose(read[inner], 0.25, atol=1e-5)


def test_surface_agrees_with_projected_points(box_vehicle: Vehicle) -> None:
    raster = view(box_vehicle, samples=2)
    surface = find_surface(raster, box_vehicle.paint_faces())
    corners = box_vehicle.positions[box_vehicle.triangles]
    rows, columns = np.nonzero(surface.index >= 0)
    camera = Camera.look_at(np.array([5.0, 3.5, 2.0]), np.array([0.0, 0.0, 0.7]), 50, 40, 32)
    points = surface.interpolate(corners)
    pixels, depths = camera.project(points)
    assert np.allclose(pixels, raster.points(rows, columns), atol=1e-6)
    # One sample to the right on the same plane lies where the slope says, up to perspective.
    for axis in range(2):
        moved, _ = camera.project(points + surface.differentiate(corners)[:, axis] * 1e-4)
        wanted = np.eye(2)[axis] * 1e-4 * surface.sample_side
        assert np.allclose(moved - pixels, wanted, atol=2e-3 * 1e-4)
    assert (depths > 0).all()


def test_bilinear_is_grid_sample(whole_box: Vehicle) -> None:
    raster, pyramid = view(whole_box), Pyramid(np.ones((SIZE, SIZE), np.float32))
    uv_map = torch.rand(3, SIZE, SIZE, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    found = look_up(whole_box, raster, pyramid, Sampler.BILINEAR)
    uv = find_surface(raster, whole_box.paint_faces()).interpolate(whole_box.uvs)
    grid = torch.from_numpy(np.stack([uv[:, 0] * 2 - 1, 1 - 2 * uv[:, 1]], -1))[None, None]
    wanted = torch_functional.grid_sample(uv_map[None], grid, align_corners=False, padding_mode="border")[0, :, 0].T
    read = colors(found, pyramid(pyramid.from_map(uv_map)).numpy())
    assert np.allclose(read, wanted.numpy(), atol=1e-6)


@pytest.mark.parametrize("distance", [1.0, 8.0, 200.0])
def test_trilinear_is_two_levels_of_the_footprint(whole_box: Vehicle, distance: float) -> None:
    raster, pyramid = view(whole_box, distance), Pyramid(np.ones((SIZE, SIZE), np.float32))
    uv_map = torch.rand(3, SIZE, SIZE, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    found = look_up(whole_box, raster, pyramid, Sampler.TRILINEAR)
    surface = find_surface(raster, whole_box.paint_faces())
    uv, jacobian = surface.interpolate(whole_box.uvs), surface.differentiate(whole_box.uvs)
    read = colors(found, pyramid(pyramid.from_map(uv_map)).numpy())
    levels = [uv_map]
    while levels[-1].shape[-1] > 1:
        levels.append(torch_functional.avg_pool2d(levels[-1][None], 2)[0])
    blurs = []
    for n in range(0, len(uv), 7):
        longest = np.linalg.svd(jacobian[n] * SIZE, compute_uv=False)[0]
        blur = min(max(np.log2(longest), 0.0), len(levels) - 1.0)
        grid = torch.tensor([[[[uv[n, 0] * 2 - 1, 1 - 2 * uv[n, 1]]]]])
        near, far = (
            torch_functional.grid_sample(levels[k][None], grid, align_corners=False, padding_mode="border")[0, :, 0, 0]
            for k in (int(blur), min(int(blur) + 1, len(levels) - 1))
        )
        wanted = near + (blur - int(blur)) * (far - near)
        assert np.allclose(read[n], wanted.numpy(), atol=1e-6)
        blurs.append(blur)
    assert {1.0: min(blurs) < 2, 8.0: max(blurs) > 1, 200.0: min(blurs) > 0}[distance]


def test_levels_wrap_or_clamp() -> None:
    pyramid = Pyramid(np.ones((4, 4), np.float32))
    ramp = np.tile(np.arange(4.0), 4)[:, None]
    uv, level = np.array([[0.0, 0.4], [1.25, 0.4], [-0.125, 0.4]]), np.zeros(3, np.int64)

    def read(wrap: bool) -> np.ndarray:
        texels, weights = read_level(pyramid, level, uv, wrap)
        return (weights * ramp[texels, 0]).sum(1)

    assert np.allclose(read(False), [0, 3, 0])
    assert np.allclose(read(True), [1.5, 0.5, 3])


def test_lookups_off_the_paint_climb_until_they_meet_some() -> None:
    coverage = np.zeros((8, 8), np.float32)
    coverage[0, 0] = 0.5
    pyramid = Pyramid(coverage)
    uv = np.array([[0.06, 0.94], [0.9, 0.1]])
    texels, weights = read_level(pyramid, np.zeros(2, np.int64), uv, by_coverage=False)
    assert np.allclose(weights.sum(1), 1)
    assert texels[0][weights[0] > 0].tolist() == [0]
    assert pyramid.tree.level[texels[1][weights[1] > 0]].tolist() == [3]


def test_mask_is_bilinear_and_ends_at_its_edge() -> None:
    mask = np.array([[0, 255], [255, 255]], np.uint8)
    uv = np.array([[0.25, 0.75], [0.5, 0.75], [0.5, 0.5], [0.0, 1.0], [1.0, 0.0]])
    assert np.allclose(mask_at(mask, uv), [0, 0.5, 0.75, 0, 1])
