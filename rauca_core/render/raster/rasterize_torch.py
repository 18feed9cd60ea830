"""The rasterizer in plain torch, for any device with float64: the same faces as `scanline`, sample for sample.

Every operation is elementwise, in the compiled path's order, so that it rounds alike; the order in which a device
scatters never shows.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .clip_torch import Triangles, clip_faces
from .fixed_point import DEPTH_TIE, FRACTION, HALF, LIMIT, Screen, Window

CHUNK = 2**22  # samples of boxes that are drawn at a time; a larger triangle goes alone


def draw(
    positions: NDArray[np.floating], triangles: NDArray[np.int32], screen: Screen, device: torch.device
) -> tuple[NDArray[np.int32], Window, int]:
    """Face ids (h, w) int32 of a window, the window (x0, y0, x1, y1) in samples, and how many vertices are broken."""
    vertices = torch.from_numpy(positions).to(device).double().T.contiguous()
    faces = torch.from_numpy(triangles).to(device).long().T.contiguous()
    points = torch.stack(
        [m[0] * vertices[0] + m[1] * vertices[1] + m[2] * vertices[2] + m[3] for m in screen.matrix.tolist()]
    )
    drawn, broken = clip_faces(points, faces, screen)
    box, hit = _boxes(drawn, screen)
    drawn, box = drawn.take(hit), box[:, hit]
    window = _window(box)
    depth = _depth_planes(points[:, faces[:, drawn.owners]])
    lines = tuple(torch.from_numpy(line).to(device) for line in screen.lines(window))
    face_ids = torch.full(((window[3] - window[1]) * (window[2] - window[0]),), -1, dtype=torch.int32, device=device)
    nearest = torch.zeros(len(face_ids), dtype=torch.float64, device=device)
    for part in _parts(box):
        chosen = drawn.take(part)
        triangle, sample, value = _cover(chosen, depth[:, part], box[:, part], lines, window, screen.columns)
        _resolve(chosen.owners.int()[triangle], sample, value, face_ids, nearest)
    return face_ids.reshape(window[3] - window[1], window[2] - window[0]).cpu().numpy(), window, broken


def _boxes(drawn: Triangles, screen: Screen) -> tuple[Tensor, Tensor]:
    """Columns and rows (4, T) that triangles may touch, first and last of each; which (H,) hold a sample at all."""
    x, y = drawn.fixed[0][drawn.corners], drawn.fixed[1][drawn.corners]
    small, large, limits = int(screen.shifts.min()), int(screen.shifts.max()), screen.limits
    begin = _first(_least(x), screen.columns, large).clamp(min=limits[0])
    end = _last(x.amax(0), screen.columns, small).clamp(max=limits[2] - 1)
    first = _first(_least(y), screen.rows, HALF).clamp(min=limits[1])
    last = _last(y.amax(0), screen.rows, HALF).clamp(max=limits[3] - 1)
    return torch.stack([begin, end, first, last]), torch.nonzero((begin <= end) & (first <= last))[:, 0]


def _first(position: Tensor, per_pixel: int, offset: Tensor | int) -> Tensor:
    return -((offset - position * per_pixel) >> FRACTION)


def _last(position: Tensor, per_pixel: int, offset: Tensor | int) -> Tensor:
    return ((position + 1) * per_pixel - 1 - offset) >> FRACTION


def _least(rows: Tensor) -> Tensor:
    """The smallest of three rows; ``amin`` takes 90 times as long on a CPU."""
    return torch.minimum(torch.minimum(rows[0], rows[1]), rows[2])


def _window(box: Tensor) -> Window:
    if not box.shape[1]:
        return 0, 0, 0, 0
    low, high = (-(-box).amax(1)).tolist(), box.amax(1).tolist()
    return low[0], low[2], high[1] + 1, high[3] + 1


def _depth_planes(corners: Tensor) -> Tensor:
    """(3, T) 1 / depth of triangles as planes over the image; NaN when seen edge-on. See `scanline`.

    Args:
        corners: (3, 3, T) homogeneous pixels: coordinates, corners, triangles.
    """
    (ax, bx, cx), (ay, by, cy), (aw, bw, cw) = corners
    bx, by, bw, cx, cy, cw = bx - ax, by - ay, bw - aw, cx - ax, cy - ay, cw - aw
    nx, ny, nw = by * cw - bw * cy, bw * cx - bx * cw, bx * cy - by * cx
    scale = 1.0 / (ax * nx + ay * ny + aw * nw)
    planes = torch.stack([nx * scale, ny * scale, nw * scale])
    size = planes.abs()
    return torch.where(size[0] + size[1] + size[2] <= LIMIT, planes, torch.nan)


def _parts(box: Tensor) -> list[slice]:
    """Runs of triangles whose boxes hold about CHUNK samples together."""
    ends = ((box[1] - box[0] + 1) * (box[3] - box[2] + 1)).cumsum(0).cpu()
    parts, start = [], 0
    while start < len(ends):
        before = int(ends[start - 1]) if start else 0
        stop = max(start + 1, int(torch.searchsorted(ends, before + CHUNK, right=True)))
        parts.append(slice(start, stop))
        start = stop
    return parts


def _cover(
    drawn: Triangles, depth: Tensor, box: Tensor, lines: tuple[Tensor, ...], window: Window, columns: int
) -> tuple[Tensor, Tensor, Tensor]:
    """The samples of triangles: which triangle, which sample of the window, its 1 / depth; by ascending triangle."""
    ys, shifts, lefts, tops = lines
    triangle, row = _expand(box[2] - window[1], box[3] - box[2] + 1)
    left, right = _spans(drawn, triangle, ys[row])
    begin = torch.maximum(box[0][triangle], _first(left, columns, shifts[row]))
    end = torch.minimum(box[1][triangle], _last(right, columns, shifts[row]))
    start = depth[0][triangle] * lefts[row] + (depth[1][triangle] * tops[row] + depth[2][triangle])
    line, column = _expand(begin, (end - begin + 1).clamp(min=0))
    triangle = triangle[line]
    bounds = drawn.over[drawn.corners]
    value = (depth[0] / columns)[triangle] * column + start[line]
    value = torch.minimum(torch.maximum(value, _least(bounds)[triangle]), bounds.amax(0)[triangle])
    return triangle, row[line] * (window[2] - window[0]) + (column - window[0]), value


def _expand(first: Tensor, number: Tensor) -> tuple[Tensor, Tensor]:
    """Count ``number[i]`` steps from ``first[i]``, for all i: which i, and the count."""
    which = torch.repeat_interleave(number)
    skipped = number.cumsum(0) - number - first
    return which, torch.arange(len(which), device=first.device) - skipped[which]


def _spans(drawn: Triangles, triangle: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
    """First and last fixed-point x (N,) of triangles on the lines at y (N,); first > last where they have none."""
    x_of, y_of = drawn.fixed[0][drawn.corners], drawn.fixed[1][drawn.corners]
    area = (x_of[1] - x_of[0]) * (y_of[2] - y_of[0]) - (x_of[2] - x_of[0]) * (y_of[1] - y_of[0])
    least = _least(x_of)
    left, right = least[triangle], torch.where(area == 0, least - 1, x_of.amax(0))[triangle]
    sign = area.sign()  # turns clockwise triangles round
    for k in range(3):
        dx, dy = (x_of[(k + 1) % 3] - x_of[k]) * sign, (y_of[(k + 1) % 3] - y_of[k]) * sign
        owns = (dy < 0) | ((dy == 0) & (dx > 0))
        level = dx[triangle] * (y - y_of[k][triangle]) + (dy * x_of[k] - (~owns).long())[triangle]
        dy = dy[triangle]
        at = torch.div(level, dy.abs().clamp(min=1), rounding_mode="floor")
        right = torch.where(dy > 0, torch.minimum(right, at), right)
        left = torch.where(dy < 0, torch.maximum(left, -at), left)
        right = torch.where((dy == 0) & (level < 0), left - 1, right)
    return left, right


def _resolve(owner: Tensor, sample: Tensor, value: Tensor, face_ids: Tensor, nearest: Tensor) -> None:
    """Show candidates (N,) in their order: each that is nearer than what its sample shows, by more than a tie.

    Where one candidate is nearer than all others by more than a tie, the order does not matter. The rest take turns.
    """
    hopeful = value > nearest[sample]
    owner, sample, value = owner[hopeful], sample[hopeful], value[hopeful]
    best = torch.zeros_like(nearest).scatter_reduce_(0, sample, value, "amax")
    rivals = value * DEPTH_TIE >= best[sample]
    disputed = (torch.bincount(sample[rivals], minlength=len(nearest)) > 1)[sample]
    _show(owner, sample, value, rivals & ~disputed, face_ids, nearest)
    if not bool(disputed.any()):
        return
    sample, order = torch.sort(sample[disputed], stable=True)
    owner, value = owner[disputed][order], value[disputed][order]
    turn = torch.arange(len(sample), device=sample.device) - torch.searchsorted(sample, sample)
    for n in range(int(turn.max()) + 1):
        _show(owner, sample, value, (turn == n) & (value > nearest[sample]), face_ids, nearest)


def _show(owner: Tensor, sample: Tensor, value: Tensor, chosen: Tensor, face_ids: Tensor, nearest: Tensor) -> None:
    face_ids[sample[chosen]] = owner[chosen]
    nearest[sample[chosen]] = value[chosen] * DEPTH_TIE
