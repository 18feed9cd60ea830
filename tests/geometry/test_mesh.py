"""Grids, welding and shading normals, against what can be worked out by hand."""

from __future__ import annotations

import numpy as np

from rauca_core.geometry.mesh import MeshParts, crease_normals, face_normals
from rauca_core.geometry.solids import half_outline, monotone_curve


def fold(angle_deg: float):
    """Two squares that share the edge x = 0 and meet at an angle."""
    lift = np.radians(angle_deg)
    x = np.array([-1.0, 0.0, np.cos(lift)])
    z = np.array([0.0, 0.0, np.sin(lift)])
    points = np.stack([np.stack([x, np.full(3, y), z], -1) for y in (0.0, 1.0)], axis=1)
    parts = MeshParts()
    parts.grid(points, "paint")
    return parts.welded()


def test_grid_faces_up_and_mirrored_copy_faces_the_same_way():
    positions, triangles, names = fold(0.0)
    assert (face_normals(positions, triangles)[0] == [0, 0, 1]).all()
    assert len(positions) == 6
    assert set(names) == {"paint"}
    parts = MeshParts()
    parts.triangles(positions[triangles], "paint")
    other, faces, _ = parts.mirrored().welded()
    assert (face_normals(other, faces)[0] == [0, 0, 1]).all()
    assert other[:, 1].max() == 0.0


def test_normals_are_smooth_below_the_crease_angle_and_split_above():
    for angle, smooth in ((20.0, True), (60.0, False)):
        positions, triangles, _ = fold(angle)
        normals = crease_normals(positions, triangles, 38.0)
        on_edge = np.isclose(positions[triangles][..., 0], 0.0)
        tilts = np.degrees(np.arccos(np.clip(normals[on_edge][:, 2], -1, 1)))
        expected = [angle / 2] if smooth else [0.0, angle]
        assert np.allclose(np.unique(np.round(tilts, 3)), expected, atol=0.01)


def test_welding_drops_degenerate_triangles_only():
    corners = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [1, 0, 0], [2, 0, 0]]], float)
    parts = MeshParts()
    parts.triangles(corners, "trim")
    positions, triangles, names = parts.welded()
    assert (len(positions), len(triangles), list(names)) == (3, 1, ["trim"])


def test_monotone_curve_meets_its_points_and_never_overshoots():
    table = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [3.0, 1.0]])
    assert np.allclose(monotone_curve(table, table[:, 0]), table[:, 1])
    values = monotone_curve(table, np.linspace(-1, 4, 500))
    assert (values.min(), values.max()) == (0.0, 1.0)
    assert (np.diff(values) >= -1e-12).all()


def test_outline_passes_its_control_points_and_crosses_the_axis_squarely():
    control = np.array([[1.0, 0.0], [0.7, 0.7], [0.0, 1.0], [-0.7, 0.7], [-1.0, 0.0]])
    line = half_outline(control)
    nearest = np.linalg.norm(line[:, None] - control, axis=2).min(axis=0)
    assert nearest.max() < 1e-12
    assert abs(line[1, 0] - line[0, 0]) < 0.05 * abs(line[1, 1] - line[0, 1])
