"""The triplanar pattern: exact, seamless, the same in a view and in the atlas."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from rauca_core.contract import Camera, RaucaError, Vehicle
from rauca_core.render import Pyramid, SparseOperator, rasterize
from rauca_core.render.sparse import from_triplets
from rauca_core.render.surface import find_surface
from rauca_core.render.world_aligned import (
    blend_weights,
    find_world_aligned,
    pattern_pyramid,
    project_pattern,
)

SIDE = 16
TILE_M = 0.8
EYE = np.array([5.0, 3.5, 2.0])


@pytest.fixture
def slanted(box_vehicle: Vehicle) -> Vehicle:
    """The box with its corners pushed about and its normals smooth: every projection takes part."""
    generator = np.random.default_rng(3)
    positions = (box_vehicle.positions + generator.uniform(-0.3, 0.3, (8, 3))).astype(np.float32)
    normals = (box_vehicle.normals + generator.uniform(-0.7, 0.7, box_vehicle.normals.shape)).astype(np.float32)
    return replace(box_vehicle, positions=positions, normals=normals)


def camera(shift: float = 0.0, distance: float = 1.0) -> Camera:
    offset = np.full(3, shift)
    return Camera.look_at(EYE * distance + offset, np.array([0.0, 0.0, 0.7]) + offset, 50, 40, 32)


def view(vehicle: Vehicle, tiles: Pyramid, shot: Camera | None = None, tile_m: float = TILE_M) -> SparseOperator:
    raster = rasterize(vehicle.positions, vehicle.triangles, shot or camera())
    found = find_world_aligned(vehicle, raster, tiles, tile_m)
    number, taps = found.texels.shape
    assert taps == 12
    rows = np.repeat(np.arange(number), taps)
    return from_triplets(rows, found.texels.ravel(), found.weights.ravel().astype(float), (number, tiles.count))


def random_pattern(tiles: Pyramid, seed: int = 0) -> torch.Tensor:
    return tiles(torch.rand(SIDE * SIDE, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)))


def bilinear_wrapped(pattern: np.ndarray, u: float, v: float) -> np.ndarray:
    """Row 0 is up; u and v in tiles."""
    x, y = u * SIDE - 0.5, -v * SIDE - 0.5
    left, top = int(np.floor(x)), int(np.floor(y))
    result = np.zeros(3)
    for row in (top, top + 1):
        for column in (left, left + 1):
            result += (1 - abs(row - y)) * (1 - abs(column - x)) * pattern[row % SIDE, column % SIDE]
    return result


def test_view_is_the_blend_of_three_projections(slanted: Vehicle) -> None:
    tiles = Pyramid(np.ones((SIDE, SIDE), np.float32))
    tile_m = 20.0  # so large that every footprint reads the finest level
    levels = random_pattern(tiles)
    pattern = levels[: SIDE * SIDE].numpy().reshape(SIDE, SIDE, 3)
    read = view(slanted, tiles, tile_m=tile_m)(levels).numpy()
    raster = rasterize(slanted.positions, slanted.triangles, camera())
    rows, columns = np.nonzero((raster.face_ids >= 0) & (raster.face_ids < 8))
    barycentrics = find_surface(raster, slanted.paint_faces()).barycentrics
    assert len(read) == len(rows) > 200
    for n in range(0, len(rows), 11):
        face = raster.face_ids[rows[n], columns[n]]
        point = barycentrics[n] @ slanted.positions[slanted.triangles[face]] / tile_m
        normal = barycentrics[n] @ slanted.normals[face]
        shares = np.abs(normal / np.linalg.norm(normal)) ** 4
        shares /= shares.sum()
        wanted = sum(
            share * bilinear_wrapped(pattern, *point[[right, up]])
            for share, (right, up) in zip(shares, ((1, 2), (0, 2), (0, 1)), strict=True)
        )
        assert np.allclose(read[n], wanted, atol=2e-6)


@pytest.mark.parametrize("distance", [1.0, 6.0])
def test_constant_pattern_keeps_its_color(slanted: Vehicle, distance: float) -> None:
    tiles = pattern_pyramid(SIDE)
    constant = torch.full((tiles.count, 3), 0.25, dtype=torch.float64)
    for rows in (
        view(slanted, tiles, camera(distance=distance)),
        project_pattern(slanted, Pyramid.of(slanted, 64), tiles, TILE_M),
    ):
        read = rows(constant)
        assert len(read) > 5
        assert torch.allclose(read, torch.full_like(read, 0.25), atol=1e-6)


def test_baked_atlas_approaches_the_view(slanted: Vehicle) -> None:
    tiles = pattern_pyramid(SIDE)
    levels = random_pattern(tiles)
    tile_m = 4.0  # a quarter of a metre per texel: magnified in both, so that filtering cannot differ
    raster = rasterize(slanted.positions, slanted.triangles, camera())
    found = find_world_aligned(slanted, raster, tiles, tile_m)
    direct = np.einsum("nk,nkc->nc", found.weights, levels.numpy()[found.texels])
    uv = find_surface(raster, slanted.paint_faces()).interpolate(slanted.uvs)
    inner = found.paint > 0.999
    assert inner.sum() > 100
    assert direct.std() > 0.1

    def error(size: int) -> float:
        atlas = Pyramid.of(slanted, size)
        rows = project_pattern(slanted, atlas, tiles, tile_m)
        assert rows.shape == (len(atlas.texels), tiles.count)
        baked = np.full((size * size, 3), np.nan)
        baked[atlas.texels] = rows(levels).numpy()
        texel = (((1 - uv[:, 1]) * size).astype(int) * size) + (uv[:, 0] * size).astype(int)
        return float(np.abs(baked[texel] - direct)[inner].mean())

    errors = [error(size) for size in (128, 256, 512)]  # of the nearest texel: as large as half a texel
    assert errors[0] > 1.7 * errors[1] > 2.9 * errors[2]
    assert errors[2] < 0.01


def test_blend_is_normalized_for_any_normal_and_power() -> None:
    normals = np.array([[0, 0, 2.0], [1, -1, 0], [1e-200, 0, 0], [0, 0, 0], [3, 4, 5.0]])
    for sharpness in (1.0, 4.0, 200.0):
        shares = blend_weights(normals, sharpness)
        assert np.allclose(shares.sum(1), 1)
        assert np.allclose(shares[:3], [[0, 0, 1], [0.5, 0.5, 0], [1, 0, 0]])
        assert np.allclose(shares[4], normals[4] ** sharpness / (normals[4] ** sharpness).sum())


def test_a_tile_must_have_a_size(slanted: Vehicle) -> None:
    for tile_m, sharpness in ((0.0, 4.0), (0.8, -1.0)):
        with pytest.raises(RaucaError, match="above 0"):
            project_pattern(slanted, Pyramid.of(slanted, 32), pattern_pyramid(4), tile_m, sharpness)


def test_an_atlas_of_another_vehicle_is_refused(slanted: Vehicle) -> None:
    whole = Pyramid(np.ones((32, 32), np.float32))
    with pytest.raises(RaucaError, match="atlas"):
        project_pattern(slanted, whole, pattern_pyramid(4), TILE_M)
