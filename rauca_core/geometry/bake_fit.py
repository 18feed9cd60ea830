"""The texture whose bilinear interpolation comes closest to given colors on the surface: linear least squares.

An average over a texel's footprint is blurred a second time when it is read. The fit is not: on a camouflage with
details as fine as its texels it gains 2 to 4 dB, and it gives the texels around a seam the values that its two sides
ask for.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .mesh import Mask

Plane = NDArray[np.float32]
Offset = tuple[int, int]
ITERATIONS = 8  # of conjugate gradients; more change less than 0.02 dB
HOLD = 0.003  # how strongly a texel is held at its plain average, per sample of a full texel


def fit_texture(
    colors: NDArray[np.float16], hit: Mask, per_texel: int, progress: Callable[[float], None]
) -> tuple[NDArray[np.float32], Mask]:
    """Fit a texture to samples on a regular grid.

    Minimizes ``sum over samples of (bilinear(t) - c)^2 + hold * |t - average|^2`` by conjugate gradients, started from
    the samples' average and clipped to [0, 1] at the end. float32: values are colors, sums run over a few dozen.

    Args:
        colors: (H * n, W * n, 3) linear, n = ``per_texel`` samples per texel and axis; read where ``hit``. A sample
            may not lie in the outermost texels: half of what it reads would be missing.
        hit: (H * n, W * n) True on samples that lie on the surface.
        progress: called with the finished share in [0, 1]; may raise to give up.

    Returns:
        The texture (H, W, 3) in [0, 1], and (H, W) True on texels that some sample's interpolation reads.
    """
    coupling = _coupling(hit, per_texel)
    weight = np.sum(list(coupling.values()), axis=0)
    read = weight > 0
    hold = np.float32(HOLD * per_texel**2)
    linear = np.empty((*weight.shape, 3), np.float32)
    for channel in range(3):
        wanted = _gathered(colors[..., channel], hit, per_texel)
        start = np.where(read, wanted / np.maximum(weight, 1e-12), 0)
        progress((channel + 0.3) / 3)
        fitted = _solve(coupling, wanted + hold * start, start, hold)
        linear[..., channel] = np.where(read, np.clip(fitted, 0, 1), 0)
        progress((channel + 1) / 3)
    return linear, read


def _phases(n: int) -> list[tuple[int, int, list[tuple[Offset, float]]]]:
    """For each sample of a texel: its place, and the four texels that it reads with their weights."""
    along = []  # offsets and weights of the two texels that each sample reads along one axis
    for place in ((phase + 0.5) / n - 0.5 for phase in range(n)):
        base = -1 if place < 0 else 0
        along.append(((base, 1 - (place - base)), (base + 1, place - base)))
    cells = [(i, j) for i in range(n) for j in range(n)]
    return [(i, j, [((y, x), a * b) for y, a in along[i] for x, b in along[j]]) for i, j in cells]


def _coupling(hit: Mask, n: int) -> dict[Offset, Plane]:
    """The normal matrix: ``coupling[d][t]`` couples the texels ``t`` and ``t + d``, neighbors or the same."""
    shape = hit.shape[0] // n, hit.shape[1] // n
    planes: dict[Offset, Plane] = {(y, x): np.zeros(shape, np.float32) for y in (-1, 0, 1) for x in (-1, 0, 1)}
    for i, j, taps in _phases(n):
        here = hit[i::n, j::n].astype(np.float32)
        for (y, x), weight in taps:
            for (other_y, other_x), other in taps:
                _add_moved(planes[other_y - y, other_x - x], here, y, x, weight * other)
    return planes


def _gathered(channel: NDArray[np.float16], hit: Mask, n: int) -> Plane:
    """The right-hand side: each texel's weighted sum of the samples that read it."""
    total: Plane = np.zeros((hit.shape[0] // n, hit.shape[1] // n), np.float32)
    for i, j, taps in _phases(n):
        here = np.where(hit[i::n, j::n], channel[i::n, j::n].astype(np.float32), 0)
        for (y, x), weight in taps:
            _add_moved(total, here, y, x, weight)
    return total


def _add_moved(total: Plane, plane: Plane, y: int, x: int, weight: float) -> None:
    """``total[t + (y, x)] += weight * plane[t]``, in place."""
    here, there = _overlap(plane.shape, y, x)
    total[there] += np.float32(weight) * plane[here]


def _overlap(shape: tuple[int, ...], y: int, x: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Index of the texels ``t`` for which ``t + (y, x)`` exists, and of those."""
    height, width = shape
    here = slice(max(0, -y), height - max(0, y)), slice(max(0, -x), width - max(0, x))
    there = slice(max(0, y), height - max(0, -y)), slice(max(0, x), width - max(0, -x))
    return here, there


def _applied(coupling: dict[Offset, Plane], texture: Plane, hold: np.float32) -> Plane:
    """The normal matrix times a texture."""
    out = (coupling[0, 0] + hold) * texture
    for (y, x), plane in coupling.items():
        if y or x:
            here, there = _overlap(plane.shape, y, x)
            out[here] += plane[here] * texture[there]
    return out


def _solve(coupling: dict[Offset, Plane], wanted: Plane, start: Plane, hold: np.float32) -> Plane:
    """Conjugate gradients from ``start``."""
    texture = start.copy()
    residual = wanted - _applied(coupling, texture, hold)
    direction, size = residual.copy(), _dot(residual, residual)
    for _ in range(ITERATIONS):
        if size <= 1e-12 * max(_dot(wanted, wanted), 1e-30):
            break
        image = _applied(coupling, direction, hold)
        step = np.float32(size / _dot(direction, image))
        texture += step * direction
        residual -= step * image
        before, size = size, _dot(residual, residual)
        direction *= np.float32(size / before)
        direction += residual
    return texture


def _dot(a: Plane, b: Plane) -> float:
    return float(np.vdot(a, b).astype(np.float64))
