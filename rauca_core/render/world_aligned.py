"""World-aligned (triplanar) textures: one square pattern, repeated, projected along the vehicle's three axes.

DTA and ACTIVE optimize such a pattern instead of a UV map: it needs no atlas and fits any vehicle, and is deployed as
a game engine's world-aligned material. A point p of the surface reads the pattern three times, at (y, z), (x, z) and
(x, y) in tiles, and blends the three by |n_x|, |n_y|, |n_z| to a power, normalized. Coordinates are the vehicle's own,
so the pattern moves with it. No projection knows which side it falls on: the pattern is mirrored on opposite sides.

Not here: the networks by which the two methods approximate this projection, where ours is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..contract import Camera, RaucaError, Vehicle
from .lookup import Fragments, read_level
from .mipmap import Pyramid
from .onto_atlas import read_on_atlas
from .raster.pattern import pattern
from .raster.rasterize import Raster
from .sampler import usual_thinning
from .sparse import SparseOperator
from .surface import Array, Surface, find_surface, mask_at
from .taps import Taps, filter_view

PLANES = ((1, 2), (0, 2), (0, 1))  # the axes that run right and up in the pattern projected along x, y and z
SHARPNESS = 4.0


def pattern_pyramid(side: int) -> Pyramid:
    """The pyramid of a square pattern of ``side`` texels: all of it is paint, and it wraps."""
    return Pyramid(np.ones((side, side), np.float32))


def find_world_aligned(
    vehicle: Vehicle, raster: Raster, tiles: Pyramid, tile_m: float, sharpness: float = SHARPNESS
) -> Fragments:
    """What every painted sample of a view reads of the pattern. K = 12: three projections of four texels.

    Each projection reads the mip level of its own footprint, chosen as for the UV map.

    Args:
        vehicle: with its paint mask.
        raster: of the vehicle, in its own frame.
        tiles: :func:`pattern_pyramid`; row 0 of the pattern is up.
        tile_m: side of a tile, metres. Tiles begin at the vehicle's origin.
        sharpness: power of the blend; larger is closer to the one projection that faces the surface.

    Raises:
        RaucaError: tile or sharpness not above 0.
    """
    surface = find_surface(raster, vehicle.paint_faces())
    texels, weights = _read_tiles(vehicle, surface, tiles, tile_m, sharpness)
    paint = mask_at(vehicle.paint_mask, np.clip(surface.interpolate(vehicle.uvs), 0.0, 1.0))
    return Fragments(surface.index, texels, weights.astype(np.float32), paint, tiles.count)


@dataclass(frozen=True)
class PatternSettings:
    """Taps on a world-aligned pattern of ``side`` texels; see :func:`find_world_aligned` and `build_taps`."""

    side: int
    tile_m: float
    samples: int = 12
    filter: str = "blackman-harris"
    sharpness: float = SHARPNESS

    def pyramid(self, vehicle: Vehicle) -> Pyramid:
        return pattern_pyramid(self.side)

    def build(self, vehicle: Vehicle, camera_in_vehicle: Camera, pyramid: Pyramid) -> Taps:
        """The taps of one view from the pattern's pyramid.

        Raises:
            RaucaError: tile or sharpness not above 0, unknown filter, too many samples.
        """

        def look(raster: Raster) -> Fragments:
            return find_world_aligned(vehicle, raster, pyramid, self.tile_m, self.sharpness)

        thinning = usual_thinning(self.samples)
        return filter_view(vehicle, camera_in_vehicle, pyramid, look, pattern(self.samples), self.filter, thinning)


def project_pattern(
    vehicle: Vehicle, atlas: Pyramid, tiles: Pyramid, tile_m: float, sharpness: float = SHARPNESS
) -> SparseOperator:
    """From the pattern's pyramid to the paintable texels of the UV atlas: the pattern as a UV map.

    A texel is the mean over its subsamples on paint, the same that decide its coverage.

    Returns:
        Operator from ``tiles.count`` texels to the ``len(atlas.texels)`` texels of ``atlas``; every row sums to 1.

    Raises:
        RaucaError: tile or sharpness not above 0; an atlas of another vehicle.
    """
    return read_on_atlas(vehicle, atlas, tiles, lambda surface: _read_tiles(vehicle, surface, tiles, tile_m, sharpness))


def _read_tiles(
    vehicle: Vehicle, surface: Surface, tiles: Pyramid, tile_m: float, sharpness: float
) -> tuple[NDArray[np.int32], Array]:
    """Texels (N, 12) of the pattern's pyramid and their weights (N, 12), each row summing to 1."""
    if not (tile_m > 0 and sharpness > 0):
        raise RaucaError(f"pattern: tile {tile_m} m and sharpness {sharpness} must be above 0")
    corners = vehicle.positions[vehicle.triangles].astype(np.float64) / tile_m
    points, slopes = surface.interpolate(corners), surface.differentiate(corners)
    blend = blend_weights(surface_normals(vehicle, surface), sharpness)
    texels, weights = np.empty((len(points), 12), np.int32), np.empty((len(points), 12))
    for axis, plane in enumerate(PLANES):
        across = slopes[:, :, plane]
        area = across[:, 0, 0] * across[:, 1, 1] - across[:, 0, 1] * across[:, 1, 0]
        blur = 0.5 * np.log2(np.maximum(np.abs(area), 1e-18)) + np.log2(tiles.size)
        level = np.clip(np.rint(blur), 0, len(tiles.sizes) - 1).astype(np.int64)
        four = slice(4 * axis, 4 * axis + 4)
        texels[:, four], weights[:, four] = read_level(tiles, level, points[:, plane], wrap=True)
        weights[:, four] *= blend[:, axis, None]
    return texels, weights


def surface_normals(vehicle: Vehicle, surface: Surface) -> Array:
    """Interpolated shading normals (N, 3), of any length; the face's own where they cancel out."""
    normals = surface.interpolate(vehicle.normals)
    a, b, c = vehicle.positions[vehicle.triangles].astype(np.float64).transpose(1, 0, 2)
    flat = np.cross(b - a, c - a)[surface.faces]
    return np.where((np.abs(normals) > 1e-6).any(1, keepdims=True), normals, flat)


def blend_weights(normals: Array, sharpness: float) -> Array:
    """|n|^sharpness, normalized to sum 1: shares (N, 3) of the projections along x, y and z; thirds where n is 0."""
    size = np.abs(normals)
    largest = size.max(1, keepdims=True)
    # Relative to the largest component, so that no power underflows for all three.
    shares = np.where(largest > 0, size / np.maximum(largest, 1e-300), 1.0) ** sharpness
    return np.asarray(shares / shares.sum(1, keepdims=True))
