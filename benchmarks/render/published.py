"""Algorithm 2 as published: the facet texture tensor is filled from the UV map anew at every step.

What the published renderer also does at every step, finding the face of every texel and of every pixel by testing all
faces, is left out: both are looked up, which is far kinder than the original.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from benchmarks.algorithm2 import pixels_from_cells, texel_faces, uv_traversal_step, uv_traversal_step_back
from rauca_core.contract import Camera
from rauca_core.render.sampler import TEXTURE_SIZE

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
