"""Many simple solids as one mesh: boxes, gabled roofs, columns and beams, with UVs in metres."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

Point = Sequence[float] | NDArray[np.floating]

# Corners of a box by number: bit 0 is x, bit 1 is y, bit 2 is z.
BOX_FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


class MeshParts:
    """Collects polygons by material name; :meth:`to_mesh` makes one mesh of them, one draw for the renderer.

    Solids are given in a local frame that :meth:`at` moves; UVs are metres in that frame.
    """

    def __init__(self) -> None:
        self._frame = np.eye(4)
        self._count = 0
        self._points: list[NDArray[np.float64]] = []
        self._corners: list[NDArray[np.int64]] = []  # (F, k) per batch
        self._uvs: list[NDArray[np.float64]] = []  # (F, k, 2) per batch
        self._batches: list[tuple[str, bool]] = []

    @contextlib.contextmanager
    def at(self, frame: NDArray[np.float64]) -> Iterator[None]:
        """Within: solids are placed by ``frame``, (4, 4) local to what surrounds it."""
        outer = self._frame
        self._frame = outer @ frame
        try:
            yield
        finally:
            self._frame = outer

    def polygons(
        self, material: str, points: ArrayLike, faces: ArrayLike, uvs: ArrayLike | None = None, smooth: bool = False
    ) -> None:
        """Add faces (F, k) of indices into ``points`` (V, 3); ``uvs`` (F, k, 2) are metres on the face by default."""
        points, faces = np.asarray(points, float).reshape(-1, 3), np.asarray(faces, np.int64)
        if not faces.size:
            return
        self._uvs.append(_metric_uvs(points[faces]) if uvs is None else np.asarray(uvs, float))
        self._points.append(points @ self._frame[:3, :3].T + self._frame[:3, 3])
        self._corners.append(faces + self._count)
        self._batches.append((material, smooth))
        self._count += len(points)

    def quads(self, material: str, corners: ArrayLike, uvs: ArrayLike | None = None) -> None:
        """Add separate quadrilaterals, corners (N, 4, 3)."""
        corners = np.asarray(corners, float).reshape(-1, 4, 3)
        self.polygons(material, corners, np.arange(4 * len(corners)).reshape(-1, 4), uvs)

    def boxes(self, material: str, lows: ArrayLike, highs: ArrayLike) -> None:
        """Add boxes along the local axes from corners ``lows`` (N, 3) to ``highs`` (N, 3)."""
        ends = np.stack([np.asarray(lows, float).reshape(-1, 3), np.asarray(highs, float).reshape(-1, 3)])
        corner = np.arange(8)
        points = np.stack([ends[corner >> axis & 1, :, axis] for axis in range(3)], axis=-1)  # (8, N, 3)
        starts = 8 * np.arange(points.shape[1])[:, None, None]
        self.polygons(material, points.swapaxes(0, 1), (starts + np.array(BOX_FACES)).reshape(-1, 4))

    def box(self, material: str, low: Point, high: Point) -> None:
        """A box along the local axes from corner ``low`` to corner ``high``."""
        self.boxes(material, np.asarray(low, float), np.asarray(high, float))

    def gable(self, material: str, low: Point, high: Point, ends: str = "") -> None:
        """A gabled roof over the rectangle, its ridge along x; ``ends`` is the material of the triangles below it."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        middle = (y0 + y1) / 2
        points = [(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0), (x0, middle, z1), (x1, middle, z1)]
        self.polygons(material, points, [(0, 1, 5, 4), (2, 3, 4, 5), (0, 3, 2, 1)])
        self.polygons(ends or material, points, [(0, 4, 3), (1, 2, 5)])

    def column(
        self, material: str, foot: Point, radius: float, height: float, sides: int = 10, taper: float = 1.0
    ) -> None:
        """A vertical prism standing on ``foot``, its top's radius ``taper`` times its foot's."""
        top = (foot[0], foot[1], foot[2] + height)
        self.beam(material, foot, top, radius, sides, taper)

    def beam(self, material: str, start: Point, end: Point, radius: float, sides: int = 6, taper: float = 1.0) -> None:
        """A round bar between two points."""
        start, end = np.asarray(start, float), np.asarray(end, float)
        along = (end - start) / np.linalg.norm(end - start)
        across = np.cross(along, (1.0, 0.0, 0.0) if abs(along[0]) < 0.9 else (0.0, 1.0, 0.0))
        across /= np.linalg.norm(across)
        angles = np.arange(sides) * 2 * math.pi / sides
        ring = radius * (np.cos(angles)[:, None] * across + np.sin(angles)[:, None] * np.cross(along, across))
        i = np.arange(sides)
        mantle = np.stack([i, (i + 1) % sides, sides + (i + 1) % sides, sides + i], axis=1)
        points = np.concatenate([start + ring, end + taper * ring])
        self.polygons(material, points, mantle, smooth=sides > 6)
        self.polygons(material, points, [i[::-1], i + sides])

    def ring(self, material: str, x: float, radius: float, tube: float) -> None:
        """A smooth ring, as a tyre, in the plane y = 0, that rolls on z = 0."""
        turns, sides = 20, 5
        around, across = np.arange(turns) * 2 * math.pi / turns, np.arange(sides) * 2 * math.pi / sides
        reach = radius - tube + tube * np.cos(across)
        y = np.broadcast_to(tube * np.sin(across), (turns, sides))
        points = np.stack([x + np.cos(around)[:, None] * reach, y, radius + np.sin(around)[:, None] * reach], axis=-1)
        i = np.arange(turns * sides).reshape(turns, sides)
        j, k = np.roll(i, -1, axis=0), np.roll(i, -1, axis=1)
        faces = np.stack([i, j, np.roll(j, -1, axis=1), k], axis=-1).reshape(-1, 4)
        self.polygons(material, points, faces, smooth=True)

    def extrusion(self, material: str, profile: ArrayLike, y0: float, y1: float) -> None:
        """A side view (N, 2), x and z in order around, drawn out across from ``y0`` to ``y1``."""
        outline = np.asarray(profile, float)
        n = len(outline)
        points = np.concatenate([np.insert(outline, 1, y, axis=1) for y in (y0, y1)])
        i = np.arange(n)
        self.polygons(material, points, np.stack([i, (i + 1) % n, n + (i + 1) % n, n + i], axis=1))
        self.polygons(material, points, [i[::-1], i + n])

    def to_mesh(self, name: str, materials: dict[str, bpy.types.Material]) -> bpy.types.Mesh:
        """One mesh with a slot per material that was used."""
        faces = [len(c) for c in self._corners]
        corners_of = np.repeat([c.shape[1] for c in self._corners], faces)
        used = sorted({material for material, _ in self._batches})
        mesh = bpy.data.meshes.new(name)
        mesh.vertices.add(self._count)
        mesh.vertices.foreach_set("co", np.concatenate(self._points).astype(np.float32).ravel())
        mesh.loops.add(int(corners_of.sum()))
        mesh.loops.foreach_set("vertex_index", np.concatenate([c.ravel() for c in self._corners]).astype(np.int32))
        mesh.polygons.add(len(corners_of))
        mesh.polygons.foreach_set("loop_start", (np.cumsum(corners_of) - corners_of).astype(np.int32))
        for material in used:
            mesh.materials.append(materials[material])
        slots = np.repeat([used.index(material) for material, _ in self._batches], faces)
        mesh.polygons.foreach_set("material_index", slots.astype(np.int32))
        mesh.polygons.foreach_set("use_smooth", np.repeat([smooth for _, smooth in self._batches], faces))
        uvs = np.concatenate([u.reshape(-1, 2) for u in self._uvs])
        mesh.uv_layers.new(name="metres").uv.foreach_set("vector", uvs.astype(np.float32).ravel())
        mesh.update(calc_edges=True)
        return mesh


def turned(angle: float, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> NDArray[np.float64]:
    """(4, 4) a turn about z by ``angle`` radians, then a shift."""
    frame = np.eye(4)
    frame[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    frame[:3, 3] = x, y, z
    return frame


def pick(rng: np.random.Generator, names: Sequence[str]) -> str:
    """One of the names."""
    return names[int(rng.integers(len(names)))]


def shifted(points: NDArray[np.float64], x: float, y: float, z: float) -> NDArray[np.float64]:
    """Points (..., 3) moved."""
    return points + np.array((x, y, z))


def _metric_uvs(faces: NDArray[np.float64]) -> NDArray[np.float64]:
    """UVs (F, k, 2) of planar faces (F, k, 3), metres: height on v for upright faces, x and y for level ones."""
    normals = np.abs(np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]))
    axes = np.array([(1, 2), (0, 2), (0, 1)])[normals.argmax(axis=1)]  # (F, 2)
    return np.take_along_axis(faces, np.broadcast_to(axes[:, None, :], (*faces.shape[:2], 2)), axis=2)
