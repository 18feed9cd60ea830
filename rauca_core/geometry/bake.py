"""Carrying a picture from one UV layout of a surface to another, without rendering: exact, and free of noise.

Texels between islands are filled so that no reader, at no mip level, meets anything but paint.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .atlas import signed_uv_area
from .bake_fit import fit_texture
from .mesh import Floats, Indices, Mask, Points, chunks, spread_out

ColorAt = Callable[[Indices, Floats], NDArray[np.float32]]
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
    read: Mask
    overlap: float


def carry(
    source_uvs: Floats,
    target_uvs: Floats,
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
    fitted, read = fit_texture(colors, hit, n, lambda share: progress(0.5 + 0.4 * share))
    read = read[1:-1, 1:-1]
    linear = fill_gaps(fitted[1:-1, 1:-1], read)
    progress(1.0)
    return Carried(linear, read, float((hits > 1).sum() / max(hit.sum(), 1)))


def samples_per_texel(source_uvs: Floats, target_uvs: Floats, source_size: int, size: int) -> int:
    """Samples per texel of the target and axis: two, or two per texel of the source where that is finer."""
    source, target = np.abs(signed_uv_area(source_uvs)), np.abs(signed_uv_area(target_uvs))
    order = np.argsort(ratio := np.sqrt(source / np.maximum(target, 1e-30)))
    reached = np.cumsum(target[order])
    dense = ratio[order][min(int(np.searchsorted(reached, 0.9 * reached[-1])), len(order) - 1)]
    return int(np.clip(np.ceil(2 * dense * source_size / size - 0.1), 2, MAX_PER_TEXEL))


def bilinear(picture: NDArray[np.float32], uv: Floats) -> NDArray[np.float32]:
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


CHUNK = 250_000  # samples at a time: some 20 ms, so that a window beside this thread stays alive


@dataclass(frozen=True, eq=False)
class Samples:
    """Sample points of the target layout that lie on a face; all arrays (N,), ``uv`` (N, 2) in the source layout."""

    face: Indices
    row: Indices
    column: Indices
    uv: Floats


def samples(source_uvs: Floats, target_uvs: Floats, side: int) -> Iterator[Samples]:
    """Visit the centers of a ``side`` x ``side`` grid over the target layout, row 0 at the top (v = 1).

    A center on the edge that two faces share belongs to one of them. Within a face the two layouts are affine to each
    other, so ``uv`` is exact. float64, for faces thinner than a texel.

    Args:
        source_uvs, target_uvs: (F, 3, 2) per corner; points outside [0, 1] of the target are left out.
    """
    corners = np.array(target_uvs, np.float64) * side
    corners[..., 1] = side - corners[..., 1]
    origin, gradient = _affine(np.asarray(source_uvs, np.float64), corners)
    face, row, first, count = _spans(corners, side)
    for chunk in chunks(count, CHUNK):
        owner, within = spread_out(count[chunk])
        span = chunk.start + owner
        column, f = first[span] + within, face[span]
        offset = np.stack([column + 0.5, row[span] + 0.5], axis=1) - corners[f, 0]
        uv = origin[f] + np.einsum("nij,nj->ni", gradient[f], offset)
        yield Samples(f, row[span], column, uv)


def _affine(source: Floats, target: Floats) -> tuple[Floats, ...]:
    """Source UV at each face's first corner (F, 2), and its change (F, 2, 2) per step in the target."""
    d, s = (np.swapaxes(x[:, 1:] - x[:, :1], 1, 2) for x in (target, source))
    area = d[:, 0, 0] * d[:, 1, 1] - d[:, 0, 1] * d[:, 1, 0]
    safe = np.where(np.abs(area) > 1e-30, area, 1.0)  # a face without area holds no center
    inverse = np.stack([d[:, 1, 1], -d[:, 0, 1], -d[:, 1, 0], d[:, 0, 0]], axis=1).reshape(-1, 2, 2)
    return source[:, 0], s @ (inverse / safe[:, None, None])


def _spans(corners: Points, side: int) -> tuple[Indices, ...]:
    """(face, row, first column, number of columns) of every run of centers inside a face."""
    low, high = (_center(f(corners[..., 1], axis=1), side) for f in (np.min, np.max))
    face, within = spread_out(high - low)
    row = low[face] + within
    left, right = np.full(len(face), -np.inf), np.full(len(face), np.inf)
    a, b, c = (corners[face, i] for i in range(3))
    turn = np.sign((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0]))
    for p, q in ((a, b), (b, c), (c, a)):
        rise = q[:, 1] - p[:, 1]
        steep = np.where(rise == 0, 1.0, rise)
        x = p[:, 0] + (q[:, 0] - p[:, 0]) * ((row + 0.5 - p[:, 1]) / steep)
        left = np.where(turn * rise < 0, np.maximum(left, x), left)
        right = np.where(turn * rise > 0, np.minimum(right, x), right)
    first = _center(left, side)
    count = np.maximum(_center(right, side) - first, 0)
    keep = (count > 0) & (turn != 0)
    return face[keep], row[keep], first[keep], count[keep]


def _center(x: Floats, side: int) -> Indices:
    """The first center at or after ``x``, within the grid."""
    return np.ceil(np.clip(x, 0, side) - 0.5).astype(np.int64)


DILATION = 8  # texels around an island that repeat its edge, so that coarse levels read across seams without a halo


def fill_gaps(linear: NDArray[np.float32], known: Mask, dilation: int = DILATION) -> NDArray[np.float32]:
    """Fill the unknown texels of a texture.

    The edge of each island is first repeated outwards for ``dilation`` texels. The rest takes, level by level, the mean
    of what is known in the same mip cell: a cell of any box-filtered mip level that holds a known texel is then exactly
    the mean of its non-empty quarters, and empty space never darkens it.

    Args:
        linear: (N, N, 3) linear; unknown texels are ignored. Mip levels go down to where N stops being even.
        known: (N, N).

    Returns:
        (N, N, 3); grey of linear 0.5 where nothing at all is known.
    """
    filled, known = _dilated(linear, known, dilation)
    return _mip_filled(filled, known)


def _dilated(linear: NDArray[np.float32], known: Mask, steps: int) -> tuple[NDArray[np.float32], Mask]:
    """Each step gives the unknown neighbors of known texels the mean of these."""
    # A border of one unknown texel spares every step the question of what lies beyond.
    colors, done = np.pad(linear, ((1, 1), (1, 1), (0, 0))), np.pad(known, 1)
    width = done.shape[1]
    ring = np.array([y * width + x for y in (-1, 0, 1) for x in (-1, 0, 1) if y or x])
    flat, flags = colors.reshape(-1, 3), done.reshape(-1)
    inside = np.pad(np.ones_like(known), 1).reshape(-1)
    frontier = np.flatnonzero(flags)
    for _ in range(steps):
        near = np.unique((frontier[:, None] + ring).ravel())
        frontier = near[inside[near] & ~flags[near]]
        around = frontier[:, None] + ring
        share = flags[around].astype(np.float32)
        mean = (flat[around] * share[..., None]).sum(axis=1) / share.sum(axis=1, keepdims=True)
        flat[frontier] = mean
        flags[frontier] = True
    return colors[1:-1, 1:-1], done[1:-1, 1:-1]


def _mip_filled(linear: NDArray[np.float32], known: Mask) -> NDArray[np.float32]:
    """Give each unknown texel the mean of its mip cell's non-empty quarters, from the coarsest level down."""
    if known.all():
        return linear
    if len(known) % 2:
        mean = linear[known].mean(axis=0, dtype=np.float64) if known.any() else 0.5
        return np.where(known[..., None], linear, mean).astype(np.float32)
    half = len(known) // 2
    quarters = known.reshape(half, 2, half, 2)
    count = quarters.sum(axis=(1, 3))
    total = np.where(known[..., None], linear, 0).reshape(half, 2, half, 2, 3).sum(axis=(1, 3))
    coarse = _mip_filled((total / np.maximum(count, 1)[..., None]).astype(np.float32), count > 0)
    return np.where(known[..., None], linear, coarse.repeat(2, axis=0).repeat(2, axis=1))
