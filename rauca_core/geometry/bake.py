"""Carrying a picture from one UV layout of a surface to another, without rendering: exact, and free of noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .atlas import signed_uv_area
from .bake_fill import fill_gaps
from .bake_fit import fit_texture
from .bake_samples import samples

ColorAt = Callable[[NDArray[np.int64], NDArray[np.float64]], NDArray[np.float32]]
MAX_PER_TEXEL = 8


@dataclass(frozen=True, eq=False)
class Carried:
    """A picture in the target layout.

    Attributes:
        linear: (N, N, 3) float32 linear, row 0 at the top; between the islands it continues them.
        read: (N, N) True on texels that the surface reads.
        overlap: share of the sample points on the surface that two faces claim; both cannot have their colors there.
    """

    linear: NDArray[np.float32]
    read: NDArray[np.bool_]
    overlap: float


def carry(
    source_uvs: NDArray[np.floating],
    target_uvs: NDArray[np.floating],
    size: int,
    color_at: ColorAt,
    source_size: int,
    progress: Callable[[float], None] = lambda done: None,
) -> Carried:
    """Carry the colors of a surface from one UV layout to another.

    Every texel of the target is sampled about twice as densely as either layout has texels, each sample reads the
    source where the same point of the surface lies in it, and the texture is the one whose bilinear interpolation
    comes closest to all of them (see `bake_fit.py`).

    Args:
        source_uvs, target_uvs: (F, 3, 2) of the same faces, u to the right, v up; the target's within [0, 1].
        size: the result is ``size`` x ``size`` texels.
        color_at: linear RGB (N, 3) at source UVs (N, 2) on faces (N,), which may differ in what they show.
        source_size: texels of the source along one side.
        progress: called now and then with the finished share; may raise to give up.
    """
    n = samples_per_texel(source_uvs, target_uvs, source_size, size)
    side = size * n
    # One texel of margin around the grid, so that no sample lies in the outermost texel. Half floats keep 11 bits of
    # a color, more than the 8 that are written, and halve the largest array of all.
    colors = np.zeros((side + 2 * n, side + 2 * n, 3), np.float16)
    hits = np.zeros((side + 2 * n, side + 2 * n), np.uint32)  # more faces may be stacked than a byte counts
    expected = max(np.abs(signed_uv_area(target_uvs)).sum() * side**2, 1.0)
    done = 0
    for found in samples(source_uvs, target_uvs, side):
        place = found.row + n, found.column + n
        colors[place] = color_at(found.face, found.uv)
        # One flat index and no wider number: the only case that NumPy counts fast in.
        np.add.at(hits.reshape(-1), np.ravel_multi_index(place, hits.shape), np.uint32(1))
        done += len(found.face)
        progress(0.5 * min(done / expected, 1.0))
    hit = hits > 0
    fit = fit_texture(colors, hit, n, lambda share: progress(0.5 + 0.4 * share))
    inside = slice(1, -1), slice(1, -1)
    linear = fill_gaps(fit.linear[inside], fit.read[inside])
    progress(1.0)
    return Carried(linear, fit.read[inside], float((hits > 1).sum() / max(hit.sum(), 1)))


def samples_per_texel(
    source_uvs: NDArray[np.floating], target_uvs: NDArray[np.floating], source_size: int, size: int
) -> int:
    """Samples per texel of the target and axis: two, or two per texel of the source where that is finer."""
    source, target = np.abs(signed_uv_area(source_uvs)), np.abs(signed_uv_area(target_uvs))
    order = np.argsort(ratio := np.sqrt(source / np.maximum(target, 1e-30)))
    reached = np.cumsum(target[order])
    dense = ratio[order][min(int(np.searchsorted(reached, 0.9 * reached[-1])), len(order) - 1)]
    return int(np.clip(np.ceil(2 * dense * source_size / size - 0.1), 2, MAX_PER_TEXEL))


def bilinear(picture: NDArray[np.float32], uv: NDArray[np.floating]) -> NDArray[np.float32]:
    """Values of a picture (H, W, C), row 0 at the top, at UVs (N, 2), as a renderer's bilinear filter reads them.

    Beyond [0, 1] the border continues.
    """
    height, width = picture.shape[:2]
    x = np.clip(uv[:, 0] * width - 0.5, 0, width - 1)
    y = np.clip((1 - uv[:, 1]) * height - 0.5, 0, height - 1)
    left, top = np.minimum(x.astype(np.int64), max(width - 2, 0)), np.minimum(y.astype(np.int64), max(height - 2, 0))
    first = top * width + left
    across, down = int(width > 1), width * int(height > 1)
    a, b = (x - left).astype(np.float32)[:, None], (y - top).astype(np.float32)[:, None]
    texels = picture.reshape(height * width, -1)  # rows of one table are picked twice as fast as pairs of indices
    above = texels.take(first, axis=0) * (1 - a) + texels.take(first + across, axis=0) * a
    below = texels.take(first + down, axis=0) * (1 - a) + texels.take(first + down + across, axis=0) * a
    return above * (1 - b) + below * b
