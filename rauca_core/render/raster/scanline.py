"""Drawing triangles into a z-buffer, one core: choose those that may hold a sample, then draw face after face.

On a small picture of a car half of the triangles fall between the samples, so these are left out first. Places in
arrays are unsigned where time counts: numba asks of every signed one whether it counts from the end.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...runtime.kernels import njit
from .triangles import BROKEN, DEPTH_TIE, FRACTION, HALF, LIMIT, ONE, Screen, Window, clip_faces, project

FEW = 16  # a box of so few samples is tested one by one, a larger one row by row
FAR = 2**30  # samples: beyond any image


def draw(
    positions: NDArray[np.floating], triangles: NDArray[np.int32], screen: Screen
) -> tuple[NDArray[np.int32], Window, int]:
    """Face ids (h, w) int32 of a window, the window (x0, y0, x1, y1) in samples, and how many vertices are broken."""
    vertices = project(positions, screen)
    corners, owners, over, fixed = triangles, np.empty(0, np.int32), vertices.over, vertices.fixed
    if vertices.state.any():
        corners, owners, over, fixed = clip_faces(*vertices, triangles, screen.planes, screen.near)
    boxes = np.empty((fixed.shape[1], 4), np.int32)
    _place(fixed, screen.columns, screen.rows, screen.shifts.min(), screen.shifts.max(), screen.limits, boxes)
    live, around = np.empty(len(corners) + 1, np.int32), np.empty((len(corners) + 1, 4), np.int32)
    number, window = _select(corners, boxes, live, around)
    face_ids = np.full((window[3] - window[1], window[2] - window[0]), -1, np.int32)
    if number:
        mesh = corners, owners, fixed, over, vertices.points, triangles
        _draw(live[:number], around, mesh, screen.columns, screen.lines(window), window, face_ids)
    return face_ids, window, int(np.count_nonzero(vertices.state == BROKEN))


@njit(cache=True, nogil=True)
def _first(position: Any, per_pixel: Any, offset: Any) -> Any:
    """The first sample at or after a fixed-point position, where sample n lies at (n * ONE + offset) // per_pixel."""
    return -((offset - position * per_pixel) >> FRACTION)


@njit(cache=True, nogil=True)
def _last(position: Any, per_pixel: Any, offset: Any) -> Any:
    """The last sample at or before a fixed-point position."""
    return ((position + 1) * per_pixel - 1 - offset) >> FRACTION


@njit(cache=True, nogil=True)
def _place(fixed: Any, columns: int, rows: int, low: int, high: int, limits: Any, boxes: Any) -> None:
    """What each vertex (2, V) adds to the box of a triangle: ``boxes`` (V, 4), x0, y0, x1, y1, within the image.

    In samples from the image's corner, all inclusive. Every vertex belongs to several triangles, so this is not asked
    per corner.
    """
    xs, ys = fixed[0], fixed[1]
    for v in range(xs.shape[0]):
        x, y = np.int64(xs[v]), np.int64(ys[v])
        boxes[v, 0], boxes[v, 1] = max(_first(x, columns, high), limits[0]), max(_first(y, rows, HALF), limits[1])
        boxes[v, 2], boxes[v, 3] = min(_last(x, columns, low), limits[2] - 1), min(_last(y, rows, HALF), limits[3] - 1)


@njit(cache=True, nogil=True)
def _select(corners: Any, boxes: Any, live: Any, around: Any) -> Any:
    """The triangles (T, 3) of vertices with ``boxes`` (V, 4) whose own box holds a sample.

    Written to ``live`` (T + 1,): which they are; to ``around`` (T + 1, 4): their boxes.

    Returns:
        how many, and the window of all of them, x1 and y1 exclusive.
    """
    number, left, top, right, bottom = np.uint64(0), FAR, FAR, -FAR, -FAR
    for t in range(np.uint64(corners.shape[0])):
        i, j, k = np.uint32(corners[t, 0]), np.uint32(corners[t, 1]), np.uint32(corners[t, 2])
        x0, y0 = min(boxes[i, 0], min(boxes[j, 0], boxes[k, 0])), min(boxes[i, 1], min(boxes[j, 1], boxes[k, 1]))
        x1, y1 = max(boxes[i, 2], max(boxes[j, 2], boxes[k, 2])), max(boxes[i, 3], max(boxes[j, 3], boxes[k, 3]))
        hit = (x0 <= x1) & (y0 <= y1)
        live[number] = t
        around[number, 0], around[number, 1], around[number, 2], around[number, 3] = x0, y0, x1, y1
        number += np.uint64(hit)  # no branch decides what is written: no processor could guess it
        if hit:
            left, top, right, bottom = min(left, x0), min(top, y0), max(right, x1), max(bottom, y1)
    return int(number), (left, top, right + 1, bottom + 1) if number else (0, 0, 0, 0)


@njit(cache=True, nogil=True, error_model="numpy")
def _draw(live: Any, boxes: Any, mesh: Any, columns: int, lines: Any, window: Any, face_ids: Any) -> None:
    """Draw the triangles ``live`` into ``face_ids`` (h, w), each at its owner's depth, within that of its corners."""
    corners, owners, fixed, over, points, triangles = mesh
    x0, y0 = window[0], window[1]
    nearest = np.zeros(face_ids.shape)
    for n in range(np.uint64(live.shape[0])):
        t = np.uint32(live[n])
        i, j, k = np.uint32(corners[t, 0]), np.uint32(corners[t, 1]), np.uint32(corners[t, 2])
        low, high = min(over[i], min(over[j], over[k])), max(over[i], max(over[j], over[k]))
        box = np.int64(boxes[n, 0]), np.int64(boxes[n, 2]), np.int64(boxes[n, 1]) - y0, np.int64(boxes[n, 3]) - y0
        a = np.int64(fixed[0, i]), np.int64(fixed[1, i])
        b = np.int64(fixed[0, j]), np.int64(fixed[1, j])
        c = np.int64(fixed[0, k]), np.int64(fixed[1, k])
        if (b[0] - a[0]) * (c[1] - a[1]) < (c[0] - a[0]) * (b[1] - a[1]):
            b, c = c, b
        face = np.uint32(owners[t]) if owners.shape[0] > 0 else t
        plane = _depth_plane(points, triangles, face)
        if not abs(plane[0]) + abs(plane[1]) + abs(plane[2]) <= LIMIT:
            continue  # seen edge-on
        depth = plane[0], plane[1], plane[2], low, high
        if columns == 1 and (box[1] - box[0] + 1) * (box[3] - box[2] + 1) <= FEW:
            _test_samples(a, b, c, box, depth, face, lines, x0, nearest, face_ids)
        else:
            _fill_rows(a, b, c, box, depth, face, columns, lines, x0, nearest, face_ids)


@njit(cache=True, nogil=True, error_model="numpy")
def _depth_plane(points: Any, triangles: Any, face: Any) -> tuple[float, float, float]:
    """1 / depth of a face as a plane over the image: its slopes along x and y, and its value at the image's corner."""
    i, j, k = np.uint32(triangles[face, 0]), np.uint32(triangles[face, 1]), np.uint32(triangles[face, 2])
    ax, ay, aw = points[0, i], points[1, i], points[2, i]
    bx, by, bw = points[0, j] - ax, points[1, j] - ay, points[2, j] - aw
    cx, cy, cw = points[0, k] - ax, points[1, k] - ay, points[2, k] - aw
    nx, ny, nw = by * cw - bw * cy, bw * cx - bx * cw, bx * cy - by * cx
    scale = 1.0 / (ax * nx + ay * ny + aw * nw)
    return nx * scale, ny * scale, nw * scale


@njit(cache=True, nogil=True, error_model="numpy")
def _test_samples(
    a: Any, b: Any, c: Any, box: Any, depth: Any, face: Any, lines: Any, x0: int, nearest: Any, face_ids: Any
) -> None:
    """Draw the triangle a, b, c by asking each sample of its box, where a pixel has one column.

    One loop, not two: the compiler would vectorize an inner one, which takes twice the time on two or three samples.
    """
    ys, shifts, lefts, tops = lines
    tie_a, tie_b, tie_c = _loses_ties(a, b), _loses_ties(b, c), _loses_ties(c, a)
    column, row = box[0], box[2]
    while row <= box[3]:
        x, y = column * ONE + shifts[row], ys[row]
        inside = (_side(a, b, x, y) - tie_a) | (_side(b, c, x, y) - tie_b) | (_side(c, a, x, y) - tie_c)
        start = depth[0] * lefts[row] + (depth[1] * tops[row] + depth[2])
        value = min(max(depth[0] * column + start, depth[3]), depth[4])
        if (inside >= 0) & (value > nearest[row, column - x0]):
            nearest[row, column - x0] = value * DEPTH_TIE
            face_ids[row, column - x0] = face
        ends = column == box[1]
        column = box[0] if ends else column + 1
        row += ends


@njit(cache=True, nogil=True, error_model="numpy")
def _fill_rows(
    a: Any,
    b: Any,
    c: Any,
    box: Any,
    depth: Any,
    face: Any,
    columns: int,
    lines: Any,
    x0: int,
    nearest: Any,
    face_ids: Any,
) -> None:
    """Draw the triangle a, b, c by cutting each row of its box to the inside of its edges."""
    ys, shifts, lefts, tops = lines
    leftmost, rightmost = min(a[0], min(b[0], c[0])), max(a[0], max(b[0], c[0]))
    step = depth[0] / columns
    for row in range(box[2], box[3] + 1):
        left, right = _cut(a, b, ys[row], leftmost, rightmost)
        left, right = _cut(b, c, ys[row], left, right)
        left, right = _cut(c, a, ys[row], left, right)
        start = depth[0] * lefts[row] + (depth[1] * tops[row] + depth[2])
        begin = max(box[0], _first(left, columns, shifts[row]))
        end = min(box[1], _last(right, columns, shifts[row]))
        for column in range(begin, end + 1):
            value = min(max(step * column + start, depth[3]), depth[4])
            if value > nearest[row, column - x0]:
                nearest[row, column - x0] = value * DEPTH_TIE
                face_ids[row, column - x0] = face


@njit(cache=True, nogil=True)
def _loses_ties(a: Any, b: Any) -> Any:
    """0 where edge a -> b owns the samples on it, a top or left edge, and 1 elsewhere."""
    return 0 if b[1] < a[1] or (b[1] == a[1] and b[0] > a[0]) else 1


@njit(cache=True, nogil=True)
def _side(a: Any, b: Any, x: Any, y: Any) -> Any:
    """The edge function: not negative on the inner side of edge a -> b."""
    return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])


@njit(cache=True, nogil=True, error_model="numpy")
def _cut(a: Any, b: Any, y: Any, left: Any, right: Any) -> Any:
    """Cut a row's positions [left, right] to the inner side of edge a -> b."""
    dy = b[1] - a[1]
    level = _side(a, b, 0, y) - _loses_ties(a, b)  # inside where level - dy * x >= 0
    if dy > 0:
        right = min(right, level // dy)
    elif dy < 0:
        left = max(left, -(level // -dy))
    elif level < 0:
        right = left - 1
    return left, right
