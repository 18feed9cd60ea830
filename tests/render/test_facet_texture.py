"""The facet texture as a texture of its own: read by views, and baked to the atlas."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from rauca_core.contract import Camera, RaucaError, Vehicle
from rauca_core.render import FacetSettings, Pyramid, bake_facets, cell_positions
from rauca_core.render.facets import cells_pyramid

TS = 5


def camera() -> Camera:
    return Camera.look_at(np.array([5.0, 3.5, 2.0]), np.array([0.0, 0.0, 0.7]), 50, 40, 32)


@pytest.mark.parametrize("size", [2, 3, 6])
def test_cells_are_a_list_without_levels(box_vehicle: Vehicle, size: int) -> None:
    cells = cells_pyramid(box_vehicle, size)
    assert cells.count == len(cells.texels) == 8 * size**3
    values = torch.rand(cells.count, 3)
    assert torch.equal(cells(values), values)
    with pytest.raises(RaucaError, match="texture size"):
        cells_pyramid(box_vehicle, 1)


def test_cells_lie_on_their_faces(box_vehicle: Vehicle) -> None:
    places = cell_positions(box_vehicle, TS).reshape(8, TS**3, 3)
    for face, points in zip(box_vehicle.triangles[:8], places, strict=True):
        a, b, c = box_vehicle.positions[face].astype(np.float64)
        shares = np.linalg.lstsq(np.stack([b - a, c - a], 1), (points - a).T, rcond=None)[0].T
        assert np.allclose(shares @ np.stack([b - a, c - a]) + a, points, atol=1e-5)
        assert shares.min() > -1e-5
        assert shares.sum(1).max() < 1 + 1e-5


def test_view_and_map_show_a_gradient_that_the_cells_hold(box_vehicle: Vehicle) -> None:
    """Cells colored by where they lie: pixels and texels then tell where they lie."""
    cells, atlas = cells_pyramid(box_vehicle, TS), Pyramid.of(box_vehicle, 64)
    colors = torch.from_numpy(cell_positions(box_vehicle, TS))
    taps = FacetSettings(8, texture_size=TS).build(box_vehicle, camera(), cells)
    seen = taps.rows(colors).numpy()[taps.alpha > 0.99]
    pixels = taps.pixels[taps.alpha > 0.99]
    shot = camera()
    there = seen @ shot.R.T + shot.t
    projected = (there @ shot.K.T)[:, :2] / there[:, 2:]
    wanted = np.stack([pixels % 40 + 0.5, pixels // 40 + 0.5], 1)
    assert np.abs(projected - wanted).mean() < 0.5  # pixels; Neural Renderer's cells are not quite linear
    baked = bake_facets(box_vehicle, atlas, cells, TS)
    assert np.allclose(np.add.reduceat(baked.weights, baked.indptr[:-1]), 1, atol=1e-5)
    on_map = baked(colors).numpy()
    inside = np.abs(on_map) <= box_vehicle.positions.max(0) + 1e-5
    assert inside.all()
    assert np.ptp(on_map, axis=0) == pytest.approx([4.0, 2.0, 1.5], rel=0.15)
