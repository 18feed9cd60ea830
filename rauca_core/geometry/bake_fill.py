"""Colors for the texels between islands: no reader, at no mip level, meets anything but paint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

DILATION = 8  # texels around an island that repeat its edge, so that coarse levels read across seams without a halo


def fill_gaps(linear: NDArray[np.float32], known: NDArray[np.bool_], dilation: int = DILATION) -> NDArray[np.float32]:
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


def _dilated(
    linear: NDArray[np.float32], known: NDArray[np.bool_], steps: int
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
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


def _mip_filled(linear: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
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
