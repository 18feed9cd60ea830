"""World-aligned (triplanar) textures: one square pattern, repeated, projected along the vehicle's three axes.

DTA and ACTIVE optimise such a pattern instead of a UV map: it needs no atlas and fits any vehicle, and is deployed as
a game engine's world-aligned material. A point p of the surface reads the pattern three times, at (y, z), (x, z) and
(x, y) in tiles, and blends the three by |n_x|, |n_y|, |n_z| to a power, normalised. Coordinates are the vehicle's own,
so the pattern moves with it. No projection knows which side it falls on: the pattern is mirrored on opposite sides.

Not here: the networks by which the two methods approximate this projection, where ours is exact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Camera, RaucaError, Vehicle
from .coverage import SUBSAMPLES
from .filters import filter_table
from .merge import Rows, filter_fragments, merge_pixels
from .product import from_triplets
from .pyramid import Pyramid
from .raster.atlas import rasterize_atlas
from .raster.pattern import pattern
from .raster.rasterise import Raster, rasterize
from .sampling.fragments import Fragments
from .sampling.mip_lookup import read_level
from .sampling.surface import Array, Surface, find_surface, mask_at
from .sparse import SparseOperator
from .taps import Taps, round_taps, usual_thinning
from .thin import Thinning

PLANES = ((1, 2), (0, 2), (0, 1))  # the axes that run right and up in the pattern projected along x, y and z
SHARPNESS = 4.0
BAND = 128  # rows of the atlas projected at once


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
    return Fragments(surface.index, texels, weights.astype(np.float32), paint)


def build_world_aligned_taps(
    vehicle: Vehicle,
    camera_in_vehicle: Camera,
    tiles: Pyramid,
    tile_m: float,
    samples: int = 12,
    filter: str = "blackman-harris",
    sharpness: float = SHARPNESS,
) -> Taps:
    """Compute the taps of one view from the pattern's pyramid, as :func:`taps.build_taps` does from the UV map's.

    Raises:
        RaucaError: tile or sharpness not above 0, unknown filter, too many samples.
    """
    rule = pattern(samples)
    table, reach = filter_table(filter, rule)
    raster = rasterize(vehicle.positions, vehicle.triangles, camera_in_vehicle, margin=reach, pattern=rule)
    found = find_world_aligned(vehicle, raster, tiles, tile_m, sharpness)
    thinning = Thinning.of(tiles.tree, usual_thinning(samples))
    rows = filter_fragments(found, raster, camera_in_vehicle, table, tiles.count, thinning)
    return round_taps(rows, camera_in_vehicle, tiles.count)


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
    paint = vehicle.paint_faces()
    uvs = np.where(paint[:, None, None], vehicle.uvs, np.float32(-9))  # other faces lie off the map
    rule = pattern(SUBSAMPLES)
    table, _ = filter_table("box", rule)
    texels_as_pixels = Camera(np.eye(3), np.eye(3), np.zeros(3), atlas.size, atlas.size)
    thinning = Thinning.of(tiles.tree, 0.0)
    parts = []
    for raster in _bands(rasterize_atlas(uvs, atlas.size, SUBSAMPLES), BAND * rule.rows):
        surface = find_surface(raster, paint)
        texels, weights = _read_tiles(vehicle, surface, tiles, tile_m, sharpness)
        solid = np.ones(len(texels), np.float32)  # paint that the mask halves has its full colour
        found = Fragments(surface.index, texels, weights.astype(np.float32), solid)
        read = merge_pixels(found, raster, texels_as_pixels, table, tiles.count, thinning)
        parts.append(_paintable_rows(read, atlas))
    if not parts or not np.array_equal(np.concatenate([part[0] for part in parts]), atlas.texels):
        raise RaucaError("pattern: the atlas holds texels that no paint face covers; give the pyramid of this vehicle")
    rows, columns, values = (np.concatenate([part[k] for part in parts]) for k in (1, 2, 3))
    return from_triplets(rows, columns, values, (len(atlas.texels), tiles.count))


def _bands(raster: Raster, rows: int) -> Iterator[Raster]:
    """A raster cut at multiples of ``rows`` sample rows: all samples of a large atlas at once take gigabytes."""
    start, end = raster.y0, raster.y0 + len(raster.face_ids)
    for first in range(start - start % rows, end, rows):
        low = max(first, start)
        yield replace(raster, face_ids=raster.face_ids[low - start : first + rows - start], y0=low)


def _paintable_rows(read: Rows, atlas: Pyramid) -> tuple[NDArray[Any], ...]:
    """What `merge_pixels` returns, as entries: paintable texels covered; row, column and value of every tap on them."""
    pixels, _, indptr, columns, values = read
    place = np.minimum(np.searchsorted(atlas.texels, pixels), len(atlas.texels) - 1)
    known = atlas.texels[place] == pixels
    taps = np.diff(indptr)
    kept = np.repeat(known, taps)
    return pixels[known], np.repeat(place, taps)[kept], columns[kept], values[kept]


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
    """|n|^sharpness, normalised to sum 1: shares (N, 3) of the projections along x, y and z; thirds where n is 0."""
    size = np.abs(normals)
    largest = size.max(1, keepdims=True)
    # Relative to the largest component, so that no power underflows for all three.
    shares = np.where(largest > 0, size / np.maximum(largest, 1e-300), 1.0) ** sharpness
    return np.asarray(shares / shares.sum(1, keepdims=True))
