"""Many simple solids as one mesh: boxes, gabled roofs, columns and blobs, with UVs in metres."""

from __future__ import annotations

import math
from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import ArrayLike, NDArray

Point = Sequence[float] | NDArray[np.floating]


class MeshParts:
    """Collects solids by material name; :meth:`to_mesh` welds them into one mesh, one draw for the renderer."""

    def __init__(self) -> None:
        self._vertices: list[tuple[float, float, float]] = []
        self._faces: list[tuple[int, ...]] = []
        self._uvs: list[tuple[float, float]] = []
        self._material: list[str] = []

    def _add(self, material: str, vertices: ArrayLike, faces: Sequence[Sequence[int]]) -> None:
        points = np.asarray(vertices, float)
        start = len(self._vertices)
        self._vertices += [tuple(p) for p in points.tolist()]
        for face in faces:
            self._faces.append(tuple(start + i for i in face))
            self._material.append(material)
            self._uvs += _metric_uvs(points[list(face)])

    def box(self, material: str, low: Point, high: Point) -> None:
        """An axis-aligned box from corner ``low`` to corner ``high``."""
        self._add(material, *box_solid(low, high))

    def gable(self, material: str, low: Point, high: Point) -> None:
        """A gabled roof over the rectangle, its ridge along x."""
        (x0, y0, z0), (x1, y1, z1) = low, high
        middle = (y0 + y1) / 2
        points = [(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0), (x0, middle, z1), (x1, middle, z1)]
        self._add(material, points, [(0, 1, 5, 4), (2, 3, 4, 5), (0, 4, 3), (1, 2, 5), (0, 3, 2, 1)])

    def column(self, material: str, foot: Point, radius: float, height: float, sides: int = 10) -> None:
        """A vertical prism standing on ``foot``."""
        angles = np.arange(sides) * 2 * math.pi / sides
        ring = np.stack([foot[0] + radius * np.cos(angles), foot[1] + radius * np.sin(angles)], axis=1)
        points = [(x, y, foot[2] + z) for z in (0.0, height) for x, y in ring]
        sides_of = [(i, (i + 1) % sides, sides + (i + 1) % sides, sides + i) for i in range(sides)]
        self._add(material, points, [*sides_of, tuple(range(sides, 2 * sides))])

    def blob(self, material: str, centre: Point, radius: float, rng: np.random.Generator) -> None:
        """A lumpy ball, for the crown of a tree."""
        rows, columns = 7, 10
        polar = np.linspace(0.0, math.pi, rows)[:, None]
        around = np.arange(columns) * 2 * math.pi / columns
        reach = radius * rng.uniform(0.8, 1.2, (rows, columns))
        reach[0], reach[-1] = radius, radius
        sphere = np.stack(
            [
                reach * np.sin(polar) * np.cos(around),
                reach * np.sin(polar) * np.sin(around),
                reach * np.cos(polar) * 0.8 + 0 * around,
            ],
            axis=-1,
        )
        faces = [
            (
                r * columns + c,
                (r + 1) * columns + c,
                (r + 1) * columns + (c + 1) % columns,
                r * columns + (c + 1) % columns,
            )
            for r in range(rows - 1)
            for c in range(columns)
        ]
        self._add(material, sphere.reshape(-1, 3) + np.asarray(centre), faces)

    def to_mesh(self, name: str, materials: dict[str, bpy.types.Material]) -> bpy.types.Mesh:
        """One mesh with a slot per material that was used."""
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata(self._vertices, [], self._faces)
        used = [key for key in materials if key in set(self._material)]
        for key in used:
            mesh.materials.append(materials[key])
        mesh.polygons.foreach_set("material_index", [used.index(key) for key in self._material])
        mesh.uv_layers.new(name="metres").uv.foreach_set("vector", np.array(self._uvs, np.float32).ravel())
        mesh.update()
        return mesh


def box_solid(low: Point, high: Point) -> tuple[list[tuple[float, float, float]], list[tuple[int, ...]]]:
    """Corners and outward faces of an axis-aligned box."""
    corners = [(x, y, z) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
    return corners, [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]


def _metric_uvs(points: NDArray[np.float64]) -> list[tuple[float, float]]:
    """UVs of a planar face, metres: height on v for upright faces, x and y for level ones."""
    normal = np.abs(np.cross(points[1] - points[0], points[2] - points[0]))
    u, v = {0: (1, 2), 1: (0, 2), 2: (0, 1)}[int(normal.argmax())]
    return [(float(p[u]), float(p[v])) for p in points]
