"""The smallest painted vehicle, for hard cases and tests."""

from __future__ import annotations

import numpy as np

from rauca_core.contract import Material, Vehicle


def painted_box() -> Vehicle:
    """A 4 x 2 x 1.5 m box: its sides painted, each a chart of its own, its top of dark trim."""
    x, y, z = 2.0, 1.0, 1.5
    corners = np.array([(sx * x, sy * y, h) for h in (0, z) for sy in (-1, 1) for sx in (-1, 1)], np.float32)
    quads = [(0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6), (4, 5, 7, 6)]
    normals = [(0, -1, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, 0, 1)]
    triangles, uvs, corner_normals, material = [], [], [], []
    for i, (quad, normal) in enumerate(zip(quads, normals, strict=True)):
        u, v = 0.05 + 0.5 * (i % 2), 0.05 + 0.5 * (i // 2 % 2)
        chart = np.array([(u, v), (u + 0.4, v), (u + 0.4, v + 0.4), (u, v + 0.4)])
        for order in ((0, 1, 2), (0, 2, 3)):
            triangles.append([quad[k] for k in order])
            uvs.append(chart[list(order)] if i < 4 else np.zeros((3, 2)))
            corner_normals.append([normal] * 3)
            material.append(0 if i < 4 else 1)
    mask = np.zeros((64, 64), np.uint8)
    for row in (0, 32):
        for column in (0, 32):
            mask[row + 2 : row + 30, column + 2 : column + 30] = 255
    return Vehicle(
        name="box",
        positions=corners,
        triangles=np.array(triangles, np.int32),
        uvs=np.array(uvs, np.float32),
        normals=np.array(corner_normals, np.float32),
        material=np.array(material, np.int16),
        materials=[Material("paint", "paint", roughness=0.5), Material("top", "trim", (0.02, 0.02, 0.02), 0.8)],
        paint_mask=mask,
        padding_texels=4,
    )
