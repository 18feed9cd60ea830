"""The compiled path of the rasterizer, one core: project the vertices, then draw face after face into a z-buffer.

Places in arrays are unsigned where time counts: numba asks of every signed one whether it counts from the end.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kernels import njit
from .boxes import first, last, place_vertices, select
from .clip import clip_faces
from .fixed_point import BROKEN, DEPTH_TIE, LIMIT, ONE, Screen, Window
from .project import project
from .small import LARGE, mark_samples

FEW = 16  # a box of so few samples is tested one by one, a larger one row by row


def draw(
    positions: NDArray[np.floating], triangles: NDArray[np.int32], screen: Screen
) -> tuple[NDArray[np.int32], Window, int]:
    """Face ids (h, w) int32 of a window, the window (x0, y0, x1, y1) in samples, and how many vertices are broken."""
    vertices = project(positions, screen)
    corners, owners, over, fixed = triangles, np.empty(0, np.int32), vertices.over, vertices.fixed
    if vertices.state.any():
        corners, owners, over, fixed = clip_faces(*vertices, triangles, screen.planes, screen.near)
    live, boxes, window = select(corners, place_vertices(fixed, screen))
    face_ids = np.full((window[3] - window[1], window[2] - window[0]), -1, np.int32)
    if face_ids.size:
        lines, columns = screen.lines(window), screen.columns
        marks, found = np.empty(len(live), np.uint8), np.empty(len(live) + 1, np.int32)
        number = mark_samples(live, boxes, corners, fixed, columns, lines, window[1], marks, found)
        mesh = corners, owners, fixed, over, vertices.points, triangles
        _draw(found[:number], live, boxes, marks, mesh, columns, lines, window, face_ids)
    return face_ids, window, int(np.count_nonzero(vertices.state == BROKEN))


@njit(cache=True, nogil=True, error_model="numpy")
def _draw(
    found: Any,
    live: Any,
    boxes: Any,
    marks: Any,
    mesh: Any,
    columns: int,
    lines: Any,
    window: Any,
    face_ids: Any,
) -> None:
    """Draw those ``found`` of the triangles ``live`` into ``face_ids`` (h, w).

    Each at its owner's depth, within that of its corners.
    """
    corners, owners, fixed, over, points, triangles = mesh
    x0, y0 = window[0], window[1]
    nearest = np.zeros(face_ids.shape)
    for m in range(np.uint64(found.shape[0])):
        n = np.uint32(found[m])
        t = np.uint32(live[n])
        i, j, k = np.uint32(corners[t, 0]), np.uint32(corners[t, 1]), np.uint32(corners[t, 2])
        low, high = min(over[i], min(over[j], over[k])), max(over[i], max(over[j], over[k]))
        box = -boxes[n, 0], boxes[n, 2], -boxes[n, 1] - y0, boxes[n, 3] - y0
        a = np.int64(fixed[0, i]), np.int64(fixed[1, i])
        b = np.int64(fixed[0, j]), np.int64(fixed[1, j])
        c = np.int64(fixed[0, k]), np.int64(fixed[1, k])
        if (b[0] - a[0]) * (c[1] - a[1]) < (c[0] - a[0]) * (b[1] - a[1]):
            b, c = c, b
        small = marks[n] < LARGE
        few = columns == 1 and (box[1] - box[0] + 1) * (box[3] - box[2] + 1) <= FEW
        if small and not _may_show_marked(marks[n], box, high, x0, nearest):
            continue
        if few and not small and not _may_show(a, b, c, box, high, lines, x0, nearest):
            continue
        face = np.uint32(owners[t]) if owners.shape[0] > 0 else t
        plane = _depth_plane(points, triangles, face)
        if not abs(plane[0]) + abs(plane[1]) + abs(plane[2]) <= LIMIT:
            continue  # seen edge-on
        depth = plane[0], plane[1], plane[2], low, high
        if small:
            _show_marked(marks[n], box, depth, face, lines, x0, nearest, face_ids)
        elif few:
            _test_samples(a, b, c, box, depth, face, lines, x0, nearest, face_ids)
        else:
            _fill_rows(a, b, c, box, depth, face, columns, lines, x0, nearest, face_ids)


@njit(cache=True, nogil=True)
def _may_show_marked(mark: Any, box: Any, high: float, x0: int, nearest: Any) -> bool:
    """Whether any marked sample shows nothing nearer than the triangle's nearest corner. Many are hidden."""
    for bit in range(4):
        row, column = np.uint64(box[2] + (bit >> 1)), np.uint64(box[0] - x0 + (bit & 1))
        if mark & (1 << bit) and high > nearest[row, column]:
            return True
    return False


@njit(cache=True, nogil=True)
def _show_marked(mark: Any, box: Any, depth: Any, face: Any, lines: Any, x0: int, nearest: Any, face_ids: Any) -> None:
    """Draw a triangle's marked samples, where a pixel has one column."""
    for bit in range(4):
        if mark & (1 << bit):
            row, column = np.uint64(box[2] + (bit >> 1)), box[0] + (bit & 1)
            start = depth[0] * lines[2][row] + (depth[1] * lines[3][row] + depth[2])
            value = min(max(depth[0] * column + start, depth[3]), depth[4])
            place = np.uint64(column - x0)
            if value > nearest[row, place]:
                nearest[row, place] = value * DEPTH_TIE
                face_ids[row, place] = face


@njit(cache=True, nogil=True, error_model="numpy")
def _may_show(a: Any, b: Any, c: Any, box: Any, high: float, lines: Any, x0: int, nearest: Any) -> bool:
    """Whether any sample lies in the triangle and shows nothing nearer than its nearest corner.

    Many triangles have a sample in their box but none inside, or are hidden: no need of their planes.
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
        begin = max(box[0], first(left, columns, shifts[row]))
        end = min(box[1], last(right, columns, shifts[row]))
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
