"""The plain neural renderer's picture of the vehicle, x_nr: the published extractor's second input.

Neural Renderer lights its mesh by itself: ambient 0.5 plus directional 0.5 from above, on sRGB values, with no shadows
and no background. So ``x_nr = color * (0.5 + 0.5 * max(n_z, 0))``, and everything else is left to the extractor. Faces
that take no camouflage are shaded in their own colors. One camera's shading serves every color, weather and place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..contract import Camera, Vehicle
from ..contract.color import linear_to_srgb
from ..render import rasterize
from ..render.raster.pattern import pattern
from ..render.surface import find_surface

AMBIENT, DIRECTIONAL = 0.5, 0.5
SUBSAMPLES = 2  # per pixel and axis, as published


@dataclass(frozen=True, eq=False)
class PlainShading:
    """What one camera sees of a vehicle under Neural Renderer's own light.

    Attributes:
        paint: (1, H, W) float32, shading of the paint times its coverage of the pixel.
        rest: (3, H, W) float32 sRGB values, the other faces in their own colors, shaded, times coverage.
        coverage: (1, H, W) float32 of the whole vehicle.
    """

    paint: Tensor
    rest: Tensor
    coverage: Tensor

    def x_nr(self, color_srgb: Tensor) -> Tensor:
        """The vehicle in paint of ``color_srgb`` (..., 3, 1, 1) or (..., 3, H, W): x_nr (..., 3, H, W), sRGB values.

        A texture is given per pixel, normalized by coverage, as the taps give it.
        """
        return color_srgb * self.paint.to(color_srgb) + self.rest.to(color_srgb)


def plain_shading(vehicle: Vehicle, camera_in_vehicle: Camera) -> PlainShading:
    """Rasterize and shade one view; see the module for the light."""
    raster = rasterize(vehicle.positions, vehicle.triangles, camera_in_vehicle, pattern=pattern(SUBSAMPLES, "grid"))
    surface = find_surface(raster, np.ones(len(vehicle.triangles), bool))
    upward = surface.interpolate(vehicle.normals[..., 2:])[:, 0]
    light = AMBIENT + DIRECTIONAL * np.maximum(upward, 0.0)
    painted = vehicle.paint_faces()[surface.faces]
    colors = linear_to_srgb(np.array([m.base_color for m in vehicle.materials]))[vehicle.material[surface.faces]]
    values = np.concatenate(
        [(light * painted)[:, None], colors * (light * ~painted)[:, None], np.ones((len(light), 1))], 1
    )
    width, height = camera_in_vehicle.width, camera_in_vehicle.height
    rows, columns = np.nonzero(surface.index >= 0)
    down, across = (rows + raster.y0) // SUBSAMPLES, (columns + raster.x0) // SUBSAMPLES
    sums = [np.bincount(down * width + across, column, height * width) for column in values.T]  # sky counts as 0
    image = (np.stack(sums, 1) / SUBSAMPLES**2).astype(np.float32).reshape(height, width, 5)
    found = torch.from_numpy(image.transpose(2, 0, 1).copy())
    return PlainShading(found[:1], found[1:4], found[4:])
