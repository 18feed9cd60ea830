"""From vertices to the triangles that the torch rasterizer draws: snapped, and clipped where they cross a plane.

Arrays have their components first, (3, N): so torch works on long rows of memory.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .clip import MAX_CORNERS
from .fixed_point import LIMIT, ONE, Screen


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles to draw, by ascending face.

    Attributes:
        corners: (3, T) int64 places in ``fixed`` and ``over``.
        owners: (T,) int64 the face that each is a part of.
        fixed: (2, N) int64 x and y in fixed point.
        over: (N,) float64 1 / depth.
    """

    corners: Tensor
    owners: Tensor
    fixed: Tensor
    over: Tensor

    def take(self, index: Tensor | slice) -> Triangles:
        return Triangles(self.corners[:, index], self.owners[index], self.fixed, self.over)


def clip_faces(points: Tensor, faces: Tensor, screen: Screen) -> tuple[Triangles, int]:
    """Snap faces (3, F) of vertices ``points`` (3, V), homogeneous pixels; how many vertices are broken.

    Faces across a clip plane become fans of what is left of them; faces of broken vertices, nothing.
    """
    usable = (points.abs() <= LIMIT).all(0)
    inside = usable & (_distances(points, screen) >= 0).all(0)
    drawn = Triangles(faces, torch.arange(faces.shape[1], device=faces.device), *_snap(points, screen))
    if bool(inside.all()):
        return drawn, 0
    whole = inside[faces].all(0)
    across = torch.nonzero(usable[faces].all(0) & ~whole)[:, 0]
    drawn = drawn.take(torch.nonzero(whole)[:, 0])
    if len(across):
        polygons, number = _clip(points[:, faces[:, across]], screen)
        drawn = _with_fans(drawn, *_snap(polygons.flatten(1), screen), number, across)
    return drawn, int((~usable).sum())


def _distances(points: Tensor, screen: Screen) -> Tensor:
    """Signed distances (5, ...) of homogeneous points (3, ...) to the clip planes."""
    x, y, w = points
    offsets = [screen.near, 0.0, 0.0, 0.0, 0.0]
    planes = screen.planes.tolist()
    return torch.stack([p[0] * x + p[1] * y + p[2] * w - o for p, o in zip(planes, offsets, strict=True)])


def _snap(points: Tensor, screen: Screen) -> tuple[Tensor, Tensor]:
    """Fixed point (2, N) and 1 / depth (N,) of points (3, N) inside the planes, but for rounding."""
    over = 1.0 / points[2].clamp(min=screen.near)
    left, right, top, bottom = screen.planes[1:, 2].tolist()
    place = [(points[0] * over).clamp(-left, right), (points[1] * over).clamp(-top, bottom)]
    return torch.round(torch.stack(place) * ONE).nan_to_num(0.0).long(), over  # broken vertices may be NaN


def _clip(corners: Tensor, screen: Screen) -> tuple[Tensor, Tensor]:
    """Sutherland-Hodgman on all triangles (3, 3, C) at once: polygons (3, MAX_CORNERS, C) and their corner counts.

    The second axis runs over corners. An intersection is computed from the end nearer to the plane, as in `clip`.
    """
    polygons = torch.nn.functional.pad(corners, (0, 0, 0, MAX_CORNERS - 3))
    number = torch.full((corners.shape[2],), 3, device=corners.device)
    at = torch.arange(MAX_CORNERS, device=corners.device)[:, None]
    for plane in range(len(screen.planes)):
        valid, following = at < number, torch.where(at + 1 < number, at + 1, 0)
        there = polygons.gather(1, following.expand_as(polygons))
        d_here, d_there = (_distances(p, screen)[plane] for p in (polygons, there))
        first = (d_here.abs() < d_there.abs()) | ((d_here >= 0) & (d_here == -d_there))
        near, far = torch.where(first, polygons, there), torch.where(first, there, polygons)
        d_near, d_far = torch.where(first, d_here, d_there), torch.where(first, d_there, d_here)
        cuts = near + d_near / (d_near - d_far) * (far - near)
        kept, crossed = valid & (d_here >= 0), valid & ((d_here >= 0) != (d_there >= 0))
        steps = kept.long() + crossed.long()
        place = torch.cumsum(steps, 0) - steps
        result, which = torch.zeros_like(polygons), torch.arange(len(number), device=at.device).expand_as(place)
        result[:, place[kept], which[kept]] = polygons[:, kept]
        result[:, (place + kept)[crossed], which[crossed]] = cuts[:, crossed]
        number = steps.sum(0)
        number, polygons = torch.where(number < 3, 0, number), result
    return polygons, number


def _with_fans(drawn: Triangles, fixed: Tensor, over: Tensor, number: Tensor, owners: Tensor) -> Triangles:
    """Add triangles (0, n, n + 1) of C polygons, whose MAX_CORNERS * C corners lie corner by corner."""
    n, which = torch.nonzero(torch.arange(MAX_CORNERS, device=number.device)[:, None] < number - 2, as_tuple=True)
    places = torch.stack([torch.zeros_like(n), n + 1, n + 2]) * len(number) + which + len(drawn.over)
    joined = Triangles(
        torch.cat([drawn.corners, places], 1),
        torch.cat([drawn.owners, owners[which]]),
        torch.cat([drawn.fixed, fixed], 1),
        torch.cat([drawn.over, over]),
    )
    return joined.take(torch.argsort(joined.owners, stable=True))
