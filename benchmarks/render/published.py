"""Algorithm 2 as published: the facet texture tensor is filled from the UV map anew at every step.

What the published renderer also does at every step, finding the face of every texel and of every pixel by testing all
faces, is left out: both are looked up, which is far kinder than the original.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from rauca_core.contract import Camera, Vehicle
from rauca_core.render import SparseOperator, rasterize
from rauca_core.render.product import from_triplets
from rauca_core.render.raster.pattern import pattern
from rauca_core.render.sampling.facet_steps import texel_faces, uv_traversal_step, uv_traversal_step_back
from rauca_core.render.sampling.facets import facet_fragments
from rauca_core.render.sampling.sampler import TEXTURE_SIZE
from rauca_core.render.sampling.surface import find_surface

from .scenes import Car

SUBSAMPLES = 2  # per pixel and axis, as published


class UvTraversalStep:
    """One view's step, forward and backward, with everything cached that depends on geometry alone."""

    def __init__(self, car: Car, camera: Camera) -> None:
        vehicle = car.vehicle
        paint = vehicle.paint_faces()
        self.uvs = vehicle.uvs[paint].astype(np.float64)
        self.faces = texel_faces(self.uvs, car.pyramid.size)
        _, self.pixels = pixels_from_cells(vehicle, camera)

    def forward(self, uv_map: NDArray[np.float32]) -> tuple[torch.Tensor, Any]:
        """A map (size, size, 3) -> colors (R, 3) of the painted pixels, and what the backward step needs."""
        cells, total = uv_traversal_step(uv_map, self.uvs, self.faces, TEXTURE_SIZE)
        leaf = torch.from_numpy(cells).reshape(-1, 3).requires_grad_()
        colors = self.pixels(leaf)
        return colors, (leaf, total)

    def backward(self, gradient: torch.Tensor, colors: torch.Tensor, kept: Any) -> NDArray[np.float32]:
        """Gradient (R, 3) on the pixels -> gradient (size, size, 3) on the map."""
        leaf, total = kept
        (on_cells,) = torch.autograd.grad(colors, leaf, gradient)
        on_cells_array = on_cells.numpy().reshape(*total.shape, 3)
        result: NDArray[np.float32] = uv_traversal_step_back(on_cells_array, total, self.uvs, self.faces)
        return result


def pixels_from_cells(vehicle: Vehicle, camera: Camera) -> tuple[NDArray[np.int64], SparseOperator]:
    """The painted pixels (R,) of a view, and how they read T_fc: eight cells per subsample, averaged over the pixel."""
    paint = vehicle.paint_faces()
    raster = rasterize(vehicle.positions, vehicle.triangles, camera, pattern=pattern(SUBSAMPLES, "grid"))
    found = facet_fragments(vehicle, find_surface(raster, paint), TEXTURE_SIZE, np.cumsum(paint) - 1)
    y, x = np.nonzero(found.index >= 0)
    pixels = (y + raster.y0) // SUBSAMPLES * camera.width + (x + raster.x0) // SUBSAMPLES
    names, row_of = np.unique(pixels, return_inverse=True)
    n = found.index[y, x]
    weights = found.weights[n] * found.paint[n, None] / SUBSAMPLES**2
    cells = found.texels[n]
    count = int(paint.sum()) * TEXTURE_SIZE**3
    rows = np.repeat(row_of, cells.shape[1])
    return names, from_triplets(rows, cells.ravel(), weights.ravel(), (len(names), count))
