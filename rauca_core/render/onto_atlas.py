"""A texture that is no UV map, carried onto the UV atlas: every texel as the surface under it looks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Camera, RaucaError, Vehicle
from .lookup import Fragments
from .merge import Rows, merge_pixels
from .mipmap import SUBSAMPLES, Pyramid
from .raster.pattern import filter_table, pattern
from .raster.rasterize import Raster, rasterize_atlas
from .sparse import SparseOperator, from_triplets
from .surface import Array, Surface, find_surface
from .thin import Thinning

BAND = 128  # rows of the atlas read at once
Look = Callable[[Surface], tuple[NDArray[np.int32], Array]]


def read_on_atlas(vehicle: Vehicle, atlas: Pyramid, colors: Pyramid, look: Look) -> SparseOperator:
    """From a list of colors to the paintable texels of the UV atlas.

    A texel is the mean over its subsamples on paint, the same that decide its coverage.

    Args:
        atlas: the vehicle's pyramid.
        colors: the list that ``look`` reads, with its levels.
        look: from surface samples to places in that list (N, K) and weights (N, K), each row summing to 1.

    Returns:
        Operator from ``colors.count`` to the ``len(atlas.texels)`` texels of ``atlas``; every row sums to 1.

    Raises:
        RaucaError: an atlas of another vehicle.
    """
    paint = vehicle.paint_faces()
    uvs = np.where(paint[:, None, None], vehicle.uvs, np.float32(-9))  # other faces lie off the map
    rule = pattern(SUBSAMPLES)
    table, _ = filter_table("box", rule)
    texels_as_pixels = Camera(np.eye(3), np.eye(3), np.zeros(3), atlas.size, atlas.size)
    thinning = Thinning.of(colors.tree, 0.0)
    parts = []
    for raster in _bands(rasterize_atlas(uvs, atlas.size, SUBSAMPLES), BAND * rule.rows):
        surface = find_surface(raster, paint)
        places, weights = look(surface)
        solid = np.ones(len(places), np.float32)  # paint that the mask halves has its full color
        found = Fragments(surface.index, places, weights.astype(np.float32), solid, colors.count)
        read = merge_pixels(found, raster, texels_as_pixels, table, thinning)
        parts.append(_paintable_rows(read, atlas))
    if not parts or not np.array_equal(np.concatenate([part[0] for part in parts]), atlas.texels):
        raise RaucaError("texture: the atlas holds texels that no paint face covers; give the pyramid of this vehicle")
    rows, columns, values = (np.concatenate([part[k] for part in parts]) for k in (1, 2, 3))
    return from_triplets(rows, columns, values, (len(atlas.texels), colors.count))


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
