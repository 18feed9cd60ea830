"""Pixels of rendered views carried into another camera by their exact distances.

Two steps. *Splat*: every pixel of every source is thrown at the place where the new camera sees its point; the nearest
wins, which gives the new view's depth. *Gather*: the point that a new pixel sees is looked up in every source, between
its four pixels; of these only those whose own distance says that they see this very point, so that colors never leak
over an edge. Sources are weighed by how much their line of sight differs from the new one: what mirrors differs too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera
from ...render.kernels import njit

FAR_M = 1e5  # where the sky is
NEAR_M = 0.02
MIXED_JUMP = 0.06  # of the inverse depth, relative: pixels on such an edge may hold a mean of both sides
MIXED_SHARE = 0.15  # of the jump: nearer to one side than this, a pixel belongs to it
LARGEST_SPLAT = 3  # pixels to each side
SAME_POINT = 0.02  # of the depth, by which two views of one point may differ
SAME_POINT_M = 0.01  # and so many metres more
SLOPES = 1.5  # and so many steps to the next pixel of a slope
FADE = 8.0  # pixels over which a source fades out towards its border
ASKED = 3  # sources that make a pixel, at most
LEAST_SHARE = 0.1  # of a lookup's four pixels that must see the point

Image = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Lens:
    """A camera as the kernels read it: ``matrix`` (3, 4) float64 from the world to pixels, ``rays`` (3, 3) float64
    from homogeneous pixels to directions in the world (unit depth), ``eye`` (3,) float64."""

    matrix: NDArray[np.float64]
    rays: NDArray[np.float64]
    eye: NDArray[np.float64]

    @staticmethod
    def of(camera: Camera) -> Lens:
        matrix = camera.K @ np.column_stack([camera.R, camera.t])
        return Lens(matrix, camera.R.T @ np.linalg.inv(camera.K), camera.position)

    def lengths(self, height: int, width: int) -> Image:
        """(H, W) length of every pixel's ray to depth 1: distance along the ray over depth along z."""
        x, y = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
        rays = [a * x + b * y + c for a, b, c in self.rays]
        return np.sqrt(sum(ray**2 for ray in rays)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Sources:
    """N views of one place.

    Attributes:
        lenses: of each.
        depth: (N, H, W) float32 metres along z, :data:`FAR_M` for sky; 0 where a pixel is not to be used.
        values: (N, H, W, C) float32 what is carried over.
        labels: (N, H, W, L) uint8 what is carried over without blending.
    """

    lenses: tuple[Lens, ...]
    depth: Image
    values: Image
    labels: NDArray[np.uint8]


def depth_of(distance: Image, lens: Lens) -> Image:
    """(H, W) metres along z of distances along the rays; infinity, the sky, becomes :data:`FAR_M`."""
    height, width = distance.shape
    return np.minimum(distance, np.float32(FAR_M)) / lens.lengths(height, width)


def mixed(depth: Image) -> Mask:
    """(H, W): True on pixels whose depth lies between those of their neighbors on both sides of a jump.

    A rendered distance is a mean over the pixel: on a silhouette it is that of neither surface. Of a plane the inverse
    depth is linear in the image: a slope is no jump.
    """
    inverse = 1.0 / np.maximum(depth, np.float32(1e-3))
    found = np.zeros(depth.shape, bool)
    for axis in (0, 1):
        before, here, after = (np.take(inverse, range(k, inverse.shape[axis] - 2 + k), axis) for k in range(3))
        low, high = np.minimum(before, after), np.maximum(before, after)
        jump = high - low
        off = np.minimum(here - low, high - here)
        between = (jump > MIXED_JUMP * high) & (off > MIXED_SHARE * jump)
        # A slope passes through the middle: there the pixel beyond goes on as steeply. An edge stops.
        inner = [slice(None), slice(None)]
        inner[axis] = slice(1, -1)
        found[tuple(inner)] |= between & ~_goes_on(inverse, axis)
    return found


def _goes_on(inverse: Image, axis: int) -> Mask:
    """Whether the steps on both sides of a pixel are alike and go on beyond its neighbors."""
    padded = np.pad(inverse, [(1, 1) if a == axis else (0, 0) for a in (0, 1)], mode="reflect", reflect_type="odd")
    steps = np.abs(np.diff(padded, axis=axis))
    count = inverse.shape[axis] - 2
    four = np.stack([np.take(steps, range(k, count + k), axis) for k in range(4)])
    return four.min(0) > 0.4 * four.max(0)


def splat(sources: Sources, chosen: NDArray[np.int64], lens: Lens, height: int, width: int) -> Image:
    """Depth (H, W) of a new view, metres along z; 0 where no source has anything to show."""
    depth = np.full((height, width), np.inf, np.float32)
    for n in chosen:
        source = sources.lenses[n]
        _splat(sources.depth[n], source.rays, source.eye, source.matrix[2], lens.matrix, depth)
    depth[np.isinf(depth)] = 0.0
    return _close(depth)


@njit(cache=True, nogil=True, error_model="numpy")
def _splat(depth: Any, rays: Any, eye: Any, axis: Any, matrix: Any, nearest: Any) -> None:
    height, width = nearest.shape
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            z = depth[row, column]
            if z <= 0.0:
                continue
            x, y = column + 0.5, row + 0.5
            px = eye[0] + z * (rays[0, 0] * x + rays[0, 1] * y + rays[0, 2])
            py = eye[1] + z * (rays[1, 0] * x + rays[1, 1] * y + rays[1, 2])
            pz = eye[2] + z * (rays[2, 0] * x + rays[2, 1] * y + rays[2, 2])
            w = matrix[2, 0] * px + matrix[2, 1] * py + matrix[2, 2] * pz + matrix[2, 3]
            if w < NEAR_M:
                continue
            u = (matrix[0, 0] * px + matrix[0, 1] * py + matrix[0, 2] * pz + matrix[0, 3]) / w
            v = (matrix[1, 0] * px + matrix[1, 1] * py + matrix[1, 2] * pz + matrix[1, 3]) / w
            half = min(0.5 * max(z / w, 1.0) + 0.1, LARGEST_SPLAT + 0.5)
            left, right = int(np.ceil(u - half - 0.5)), int(np.floor(u + half - 0.5))
            top, bottom = int(np.ceil(v - half - 0.5)), int(np.floor(v + half - 0.5))
            for r in range(max(top, 0), min(bottom, height - 1) + 1):
                for c in range(max(left, 0), min(right, width - 1) + 1):
                    if w < nearest[r, c]:
                        nearest[r, c] = w


@njit(cache=True, nogil=True)
def _close(depth: Any) -> Any:
    """Pixels without a depth that lie between such with one, above and below or to both sides, take their mean."""
    closed = depth.copy()
    height, width = depth.shape
    for r in range(height):
        for c in range(width):
            if depth[r, c] > 0.0:
                continue
            best = 0.0
            if 0 < c < width - 1 and depth[r, c - 1] > 0.0 and depth[r, c + 1] > 0.0:
                best = max(depth[r, c - 1], depth[r, c + 1])
            if 0 < r < height - 1 and depth[r - 1, c] > 0.0 and depth[r + 1, c] > 0.0:
                best = max(best, depth[r - 1, c], depth[r + 1, c])
            closed[r, c] = best
    return closed


def farther(depth: Image, weight: Image) -> Image:
    """What else pixels may show whose depth no source confirmed (``weight`` 0): 0 at all others.

    A splat is as large as its pixel and a little larger: along silhouettes it covers what lies behind. So the farthest
    confirmed depth of the neighbors is tried.
    """
    return _farther(depth, weight)


@njit(cache=True, nogil=True)
def _farther(depth: Any, weight: Any) -> Any:
    height, width = depth.shape
    found = np.zeros(depth.shape, np.float32)
    for r in range(height):
        for c in range(width):
            if weight[r, c] > 0.0:
                continue
            best = np.float32(0.0)
            for rr in range(max(r - 1, 0), min(r + 2, height)):
                for cc in range(max(c - 1, 0), min(c + 2, width)):
                    if weight[rr, cc] > 0.0:
                        best = max(best, depth[rr, cc])
            found[r, c] = best
    return found


@dataclass(frozen=True, eq=False)
class Gathered:
    """What sources say of a new view.

    Attributes:
        values: (H, W, C) float32 their weighted mean; 0 where none sees the point.
        labels: (H, W, L) uint8 of the nearest pixel of the source that counts most.
        weight: (H, W) float32, 0 where no source sees the point.
    """

    values: Image
    labels: NDArray[np.uint8]
    weight: Image


def gather(
    sources: Sources,
    chosen: NDArray[np.int64],
    depth: Image,
    lens: Lens,
    sharpness: float,
    same_point: float = SAME_POINT,
) -> Gathered:
    """Look up the points of a new view's ``depth`` (H, W) in the first :data:`ASKED` of ``chosen`` that see them.

    Args:
        depth: metres along z; 0 where nothing is to be looked up.
        sharpness: how fast a source's weight falls with the angle between its line of sight and the new one: at
            1 / sharpness radians it is a half.
        same_point: of the depth, by which that of a source may differ.
    """
    height, width = depth.shape
    values = np.zeros((height, width, sources.values.shape[-1]), np.float32)
    labels = np.zeros((height, width, sources.labels.shape[-1]), np.uint8)
    weight, best = np.zeros((height, width), np.float32), np.zeros((height, width), np.float32)
    _gather(
        (sources.depth, sources.values, sources.labels), _packed(sources, chosen), depth, (lens.rays, lens.eye),
        (sharpness**2, same_point, ASKED), (values, labels, weight, best),
    )  # fmt: skip
    values /= np.maximum(weight, np.float32(1e-20))[..., None]
    return Gathered(values, labels, weight)


def refine(sources: Sources, chosen: NDArray[np.int64], depth: Image, lens: Lens) -> Image:
    """A splat's depth (H, W) is that of a source pixel's middle, off by half a pixel's slope: one step towards the
    depth that the first source which sees the point has there."""
    found = depth.copy()
    _refine(sources.depth, _packed(sources, chosen), depth, (lens.rays, lens.eye), SAME_POINT, found)
    return found


def _packed(sources: Sources, chosen: NDArray[np.int64]) -> tuple[NDArray[np.int64], Any, Any]:
    """Numbers, matrices (n, 3, 4) and eyes (n, 3) of sources."""
    lenses = [sources.lenses[n] for n in chosen.tolist()]
    return chosen, np.stack([lens.matrix for lens in lenses]), np.stack([lens.eye for lens in lenses])


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(source: Any, packed: Any, depth: Any, lens: Any, rule: Any, found: Any) -> None:
    depths, colors, ids = source
    chosen, matrices, eyes = packed
    rays, eye = lens
    sharpness, same_point, asked = rule
    values, labels, weight, best = found
    height, width = depths.shape[1:]
    shares = np.zeros(4)
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            z = depth[row, column]
            if z <= 0.0:
                continue
            x, y = column + 0.5, row + 0.5
            dx = z * (rays[0, 0] * x + rays[0, 1] * y + rays[0, 2])
            dy = z * (rays[1, 0] * x + rays[1, 1] * y + rays[1, 2])
            dz = z * (rays[2, 0] * x + rays[2, 1] * y + rays[2, 2])
            px, py, pz = eye[0] + dx, eye[1] + dy, eye[2] + dz
            here, met = dx * dx + dy * dy + dz * dz, 0
            for k in range(chosen.shape[0]):
                n = chosen[k]
                u, v, w = _project(matrices[k], px, py, pz)
                if w < NEAR_M or not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
                    continue
                total = _agreed(depths[n], u, v, w, same_point, shares)
                if total < LEAST_SHARE:
                    continue
                sx, sy, sz = px - eyes[k, 0], py - eyes[k, 1], pz - eyes[k, 2]
                there = sx * sx + sy * sy + sz * sz
                cosine = (dx * sx + dy * sy + dz * sz) / np.sqrt(here * there)
                angle = max(2.0 - 2.0 * cosine, 0.0) * sharpness  # squared
                border = min(min(u, width - 1 - u), min(v, height - 1 - v)) / FADE
                strength = total * min(max(border, 0.02), 1.0) / ((1.0 + angle * angle) * max(there / here, 1.0))
                left, top = int(np.floor(u)), int(np.floor(v))
                largest = 0
                for i in range(4):
                    if shares[i] > 0.0:
                        factor = strength * shares[i] / total
                        for channel in range(values.shape[2]):
                            values[row, column, channel] += factor * colors[n, top + i // 2, left + i % 2, channel]
                        if shares[i] > shares[largest]:
                            largest = i
                weight[row, column] += strength
                if strength > best[row, column]:
                    best[row, column] = strength
                    for channel in range(labels.shape[2]):
                        labels[row, column, channel] = ids[n, top + largest // 2, left + largest % 2, channel]
                met += 1
                if met == asked:
                    break


@njit(cache=True, nogil=True, error_model="numpy")
def _refine(depths: Any, packed: Any, depth: Any, lens: Any, same_point: float, found: Any) -> None:
    chosen, matrices, _ = packed
    rays, eye = lens
    height, width = depths.shape[1:]
    shares = np.zeros(4)
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            z = depth[row, column]
            if z <= 0.0:
                continue
            x, y = column + 0.5, row + 0.5
            px = eye[0] + z * (rays[0, 0] * x + rays[0, 1] * y + rays[0, 2])
            py = eye[1] + z * (rays[1, 0] * x + rays[1, 1] * y + rays[1, 2])
            pz = eye[2] + z * (rays[2, 0] * x + rays[2, 1] * y + rays[2, 2])
            for k in range(chosen.shape[0]):
                n = chosen[k]
                u, v, w = _project(matrices[k], px, py, pz)
                if w < NEAR_M or not (-0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5):
                    continue
                total = _agreed(depths[n], u, v, w, same_point, shares)
                if total < LEAST_SHARE:
                    continue
                left, top, mean = int(np.floor(u)), int(np.floor(v)), 0.0
                for i in range(4):
                    if shares[i] > 0.0:
                        mean += shares[i] * depths[n, top + i // 2, left + i % 2]
                found[row, column] = z * mean / (total * w)
                break


@njit(cache=True, nogil=True, error_model="numpy")
def _project(matrix: Any, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Places among pixels' middles, and depth."""
    w = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
    if w < NEAR_M:
        return 0.0, 0.0, w
    u = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]) / w - 0.5
    v = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]) / w - 0.5
    return u, v, w


@njit(cache=True, nogil=True)
def _agreed(depths: Any, u: float, v: float, w: float, same_point: float, shares: Any) -> float:
    """Bilinear shares of the four pixels around a place, 0 for those that do not see a point of depth w; their sum."""
    height, width = depths.shape
    left, top, total = int(np.floor(u)), int(np.floor(v)), 0.0
    right_share, low_share = u - left, v - top
    limit = same_point * w + SAME_POINT_M
    for i in range(4):
        shares[i] = 0.0
        r, c = top + i // 2, left + i % 2
        if r < 0 or c < 0 or r >= height or c >= width:
            continue
        there = depths[r, c]
        if there <= 0.0:
            continue
        off = abs(there - w)
        # On a slope neighbors differ by more: allowed is what the step to the pixel beyond is.
        if off > limit and off > limit + SLOPES * _slope(depths, r, c):
            continue
        shares[i] = (right_share if i % 2 else 1.0 - right_share) * (low_share if i // 2 else 1.0 - low_share)
        total += shares[i]
    return total


@njit(cache=True, nogil=True)
def _slope(depths: Any, row: int, column: int) -> float:
    """The smaller of the steps in depth to the two sides, the larger of rows and columns: a slope's, not an edge's."""
    height, width = depths.shape
    here, found = depths[row, column], 0.0
    if 0 < column < width - 1 and depths[row, column - 1] > 0.0 and depths[row, column + 1] > 0.0:
        found = min(abs(depths[row, column - 1] - here), abs(depths[row, column + 1] - here))
    if 0 < row < height - 1 and depths[row - 1, column] > 0.0 and depths[row + 1, column] > 0.0:
        found = max(found, min(abs(depths[row - 1, column] - here), abs(depths[row + 1, column] - here)))
    return found


@njit(cache=True, nogil=True)
def fill_holes(values: Any, known: Any) -> None:
    """Give every pixel of ``values`` (H, W, C) that is not ``known`` (H, W) the mean of the nearest known ones.

    In place; row by row and column by column: of the four known pixels met to the left, right, above and below, each
    by the inverse square of its distance. Where a whole image knows nothing, 0 stays.
    """
    height, width, channels = values.shape
    offsets = np.zeros((4, height, width), np.int32)  # to the nearest known pixel; 0 is none
    for r in range(height):
        last = -1
        for c in range(width):
            if known[r, c]:
                last = c
            elif last >= 0:
                offsets[0, r, c] = c - last
        last = -1
        for c in range(width - 1, -1, -1):
            if known[r, c]:
                last = c
            elif last >= 0:
                offsets[1, r, c] = last - c
    for c in range(width):
        last = -1
        for r in range(height):
            if known[r, c]:
                last = r
            elif last >= 0:
                offsets[2, r, c] = r - last
        last = -1
        for r in range(height - 1, -1, -1):
            if known[r, c]:
                last = r
            elif last >= 0:
                offsets[3, r, c] = last - r
    for r in range(height):
        for c in range(width):
            if known[r, c]:
                continue
            total = 0.0
            for k in range(4):
                step = offsets[k, r, c]
                if step == 0:
                    continue
                weight = 1.0 / (step * step)
                rr = r - step if k == 2 else (r + step if k == 3 else r)
                cc = c - step if k == 0 else (c + step if k == 1 else c)
                total += weight
                for channel in range(channels):
                    values[r, c, channel] += weight * values[rr, cc, channel]
            if total > 0.0:
                for channel in range(channels):
                    values[r, c, channel] /= total
