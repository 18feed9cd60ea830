"""The compiled path of the rasteriser, one core: project the vertices, then draw face after face into a z-buffer.

Places in arrays are unsigned where time counts: numba asks of every signed one whether it counts from the end.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from .clip import clip_faces
from .fixed_point import BROKEN, DEPTH_TIE, FRACTION, HALF, INSIDE, LIMIT, ONE, OUTSIDE, Screen, Window

FEW = 16  # a box of so few samples is tested one by one, a larger one row by row


def draw(
    positions: NDArray[np.floating], triangles: NDArray[np.int32], screen: Screen
) -> tuple[NDArray[np.int32], Window, int]:
    """Face ids (h, w) int32 of a window, the window (x0, y0, x1, y1) in samples, and how many vertices are broken."""
    number = len(positions)
    points, over = np.empty((number, 3)), np.empty(number)
    fixed, state = np.zeros((number, 2), np.int32), np.empty(number, np.uint8)
    broken = _project(positions, screen.matrix, screen.planes, screen.near, points, over, fixed, state)
    corners, owners = triangles, np.arange(len(triangles), dtype=np.int32)
    if state.any():
        corners, owners, over, fixed = clip_faces(points, over, fixed, state, triangles, screen.planes, screen.near)
    spans = _place_vertices(fixed, screen.columns, screen.shifts)
    live, window = _select(corners, spans, screen.limits)
    face_ids = np.full((window[3] - window[1], window[2] - window[0]), -1, np.int32)
    if face_ids.size:
        lines = screen.lines(window)
        _draw(live, corners, owners, fixed, spans, over, points, triangles, screen.columns, lines, window, face_ids)
    return face_ids, window, broken


@njit(cache=True, nogil=True, error_model="numpy")
def _project(
    positions: Any, matrix: Any, planes: Any, near: float, points: Any, over: Any, fixed: Any, state: Any
) -> int:
    """Vertices to homogeneous pixels, 1 / depth, fixed point and where they lie; returns how many are broken."""
    left, right, top, bottom = planes[1, 2], planes[2, 2], planes[3, 2], planes[4, 2]
    broken = 0
    for v in range(positions.shape[0]):
        p, q, r = np.float64(positions[v, 0]), np.float64(positions[v, 1]), np.float64(positions[v, 2])
        x = matrix[0, 0] * p + matrix[0, 1] * q + matrix[0, 2] * r + matrix[0, 3]
        y = matrix[1, 0] * p + matrix[1, 1] * q + matrix[1, 2] * r + matrix[1, 3]
        w = matrix[2, 0] * p + matrix[2, 1] * q + matrix[2, 2] * r + matrix[2, 3]
        points[v, 0], points[v, 1], points[v, 2] = x, y, w
        if not (abs(x) <= LIMIT and abs(y) <= LIMIT and abs(w) <= LIMIT):
            state[v], broken = BROKEN, broken + 1
        elif w >= near and x + left * w >= 0 and right * w - x >= 0 and y + top * w >= 0 and bottom * w - y >= 0:
            state[v], over[v] = INSIDE, 1.0 / w
            fixed[v, 0], fixed[v, 1] = np.int32(np.rint(x * over[v] * ONE)), np.int32(np.rint(y * over[v] * ONE))
        else:
            state[v] = OUTSIDE
    return broken


@njit(cache=True, nogil=True)
def _place_vertices(fixed: Any, columns: int, shifts: Any) -> Any:
    """First column at or after each vertex (V, 4) int32, last column at or before it, and alike for rows.

    A triangle's box runs from the least first to the greatest last of its corners. Every vertex belongs to several
    triangles, so this is not asked per corner.
    """
    rows, low, high = shifts.shape[0], shifts.min(), shifts.max()
    spans = np.empty((fixed.shape[0], 4), np.int32)
    for v in range(fixed.shape[0]):
        x, y = np.int64(fixed[v, 0]), np.int64(fixed[v, 1])
        spans[v, 0], spans[v, 1] = _first(x, columns, high), _last(x, columns, low)
        spans[v, 2], spans[v, 3] = _first(y, rows, HALF), _last(y, rows, HALF)
    return spans


@njit(cache=True, nogil=True, error_model="numpy")
def _select(corners: Any, spans: Any, limits: Any) -> Any:
    """Triangles whose box holds a sample of the image, and the window x0, y0, x1, y1 of those boxes.

    Without branches: on a car half of the faces fall between the samples, and no processor can guess which.
    """
    live, number = np.empty(corners.shape[0], np.int32), 0
    left, top, right, bottom = (
        np.int32(limits[0]),
        np.int32(limits[1]),
        np.int32(limits[2] - 1),
        np.int32(limits[3] - 1),
    )
    x0, y0, x1, y1 = right, bottom, left, top
    for t in range(corners.shape[0]):
        i, j, k = np.uint32(corners[t, 0]), np.uint32(corners[t, 1]), np.uint32(corners[t, 2])
        begin = max(left, min(spans[i, 0], min(spans[j, 0], spans[k, 0])))
        end = min(right, max(spans[i, 1], max(spans[j, 1], spans[k, 1])))
        first = max(top, min(spans[i, 2], min(spans[j, 2], spans[k, 2])))
        last = min(bottom, max(spans[i, 3], max(spans[j, 3], spans[k, 3])))
        hit = (begin <= end) & (first <= last)
        live[number] = t
        number += hit
        x0, x1 = min(x0, begin if hit else x0), max(x1, end if hit else x1)
        y0, y1 = min(y0, first if hit else y0), max(y1, last if hit else y1)
    return live[:number], (int(x0), int(y0), int(x1) + 1, int(y1) + 1) if number else (0, 0, 0, 0)


@njit(cache=True, nogil=True)
def _first(position: Any, per_pixel: Any, offset: Any) -> Any:
    """The first sample at or after a fixed-point position, where sample n lies at (n * ONE + offset) // per_pixel."""
    return -((offset - position * per_pixel) >> FRACTION)


@njit(cache=True, nogil=True)
def _last(position: Any, per_pixel: Any, offset: Any) -> Any:
    """The last sample at or before a fixed-point position."""
    return ((position + 1) * per_pixel - 1 - offset) >> FRACTION


@njit(cache=True, nogil=True, error_model="numpy")
def _draw(
    live: Any,
    corners: Any,
    owners: Any,
    fixed: Any,
    spans: Any,
    over: Any,
    points: Any,
    triangles: Any,
    columns: int,
    lines: Any,
    window: Any,
    face_ids: Any,
) -> None:
    """Draw the triangles ``live`` into ``face_ids`` (h, w), each at its owner's depth, within that of its corners."""
    x0, y0, x1, y1 = window
    nearest = np.zeros(face_ids.shape)
    for n in range(live.shape[0]):
        t = np.uint32(live[n])
        i, j, k = np.uint32(corners[t, 0]), np.uint32(corners[t, 1]), np.uint32(corners[t, 2])
        a = np.int64(fixed[i, 0]), np.int64(fixed[i, 1])
        b = np.int64(fixed[j, 0]), np.int64(fixed[j, 1])
        c = np.int64(fixed[k, 0]), np.int64(fixed[k, 1])
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if area == 0:
            continue
        if area < 0:
            b, c = c, b
        begin = max(x0, min(spans[i, 0], min(spans[j, 0], spans[k, 0])))
        end = min(x1 - 1, max(spans[i, 1], max(spans[j, 1], spans[k, 1])))
        first = max(y0, min(spans[i, 2], min(spans[j, 2], spans[k, 2]))) - y0
        last = min(y1 - 1, max(spans[i, 3], max(spans[j, 3], spans[k, 3]))) - y0
        box = begin, end, first, last
        low, high = min(over[i], min(over[j], over[k])), max(over[i], max(over[j], over[k]))
        few = columns == 1 and (end - begin + 1) * (last - first + 1) <= FEW
        if few and not _may_show(a, b, c, box, high, lines, x0, nearest):
            continue
        plane = _depth_plane(points, triangles, np.uint32(owners[t]))
        if not abs(plane[0]) + abs(plane[1]) + abs(plane[2]) <= LIMIT:
            continue  # seen edge-on
        depth = plane[0], plane[1], plane[2], low, high
        if few:
            _test_samples(a, b, c, box, depth, owners[t], lines, x0, nearest, face_ids)
        else:
            _fill_rows(a, b, c, box, depth, owners[t], columns, lines, x0, nearest, face_ids)


@njit(cache=True, nogil=True, error_model="numpy")
def _may_show(a: Any, b: Any, c: Any, box: Any, high: float, lines: Any, x0: int, nearest: Any) -> bool:
    """Whether any sample lies in the triangle and shows nothing nearer than its nearest corner.

    Half of a car's triangles have a sample in their box but none inside, or are hidden: no need of their planes.
    """
    ys, shifts = lines[0], lines[1]
    tie_a, tie_b, tie_c = _loses_ties(a, b), _loses_ties(b, c), _loses_ties(c, a)
    column, row = box[0], box[2]
    while row <= box[3]:
        x, y = column * ONE + shifts[row], ys[row]
        inside = (_side(a, b, x, y) - tie_a) | (_side(b, c, x, y) - tie_b) | (_side(c, a, x, y) - tie_c)
        if (inside >= 0) & (high > nearest[row, column - x0]):
            return True
        ends = column == box[1]
        column = box[0] if ends else column + 1
        row += ends
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def _depth_plane(points: Any, triangles: Any, face: Any) -> tuple[float, float, float]:
    """1 / depth of a face as a plane over the image: its slopes along x and y, and its value at the image's corner."""
    i, j, k = np.uint32(triangles[face, 0]), np.uint32(triangles[face, 1]), np.uint32(triangles[face, 2])
    ax, ay, aw = points[i, 0], points[i, 1], points[i, 2]
    bx, by, bw = points[j, 0] - ax, points[j, 1] - ay, points[j, 2] - aw
    cx, cy, cw = points[k, 0] - ax, points[k, 1] - ay, points[k, 2] - aw
    nx, ny, nw = by * cw - bw * cy, bw * cx - bx * cw, bx * cy - by * cx
    scale = 1.0 / (ax * nx + ay * ny + aw * nw)
    return nx * scale, ny * scale, nw * scale


@njit(cache=True, nogil=True, error_model="numpy")
def _test_samples(
    a: Any, b: Any, c: Any, box: Any, depth: Any, face: int, lines: Any, x0: int, nearest: Any, face_ids: Any
) -> None:
    """Draw the triangle a, b, c by asking each sample of its box, where a pixel has one column.

    One loop, not two: the compiler would vectorise an inner one, which takes twice the time on two or three samples.
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
    face: int,
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
