"""What a camera sees of the vehicle itself: coverage, depth and parts, rasterized from its mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera, Vehicle
from ...contract.semantics import CLASS_IDS
from ...render import rasterize
from ...render.kernels import njit
from ...render.raster.pattern import filter_table, pattern
from ...render.surface import bilinear_mask

SAMPLES = 4  # per pixel and axis
_CLASSES = {"paint": "paint", "glass": "glass", "tyre": "tyre"}  # of a material's kind; all others: vehicle_part


@dataclass(frozen=True, eq=False)
class Body:
    """The vehicle alone in a view; (H, W) each.

    Attributes:
        vehicle, paint: float32 coverage in [0, 1], filtered as Cycles filters pixels; the paint's with its mask.
        depth: float32 metres along z at the pixel's center, or at the sample nearest to it that shows the vehicle;
            0 where none of the pixel's own does.
        classes: uint8 semantic class there; 0 off the vehicle.
        center: True where the pixel's center itself shows the vehicle.
    """

    vehicle: NDArray[np.float32]
    paint: NDArray[np.float32]
    depth: NDArray[np.float32]
    classes: NDArray[np.uint8]
    center: NDArray[np.bool_]


def see_body(vehicle: Vehicle, camera_in_vehicle: Camera, samples: int = SAMPLES) -> Body:
    """Rasterize one view of a vehicle; ``camera_in_vehicle`` is in the vehicle's own frame."""
    rule = pattern(samples)
    table, reach = filter_table("blackman-harris", rule)
    raster = rasterize(vehicle.positions, vehicle.triangles, camera_in_vehicle, margin=reach, pattern=rule)
    height, width = camera_in_vehicle.height, camera_in_vehicle.width
    coverage, depth = np.zeros((height, width, 2), np.float32), np.zeros((height, width), np.float32)
    classes, nearest = np.zeros((height, width), np.uint8), np.full((height, width), np.inf, np.float32)
    kinds = np.array([CLASS_IDS[_CLASSES.get(m.kind, "vehicle_part")] for m in vehicle.materials], np.uint8)
    _see(
        (raster.face_ids, raster.planes, raster.x0, raster.y0, raster.margin),
        (rule.columns, rule.rows, rule.shifts, table),
        (vehicle.uvs.astype(np.float64), vehicle.paint_mask, kinds[vehicle.material]),
        (CLASS_IDS["paint"], CLASS_IDS["vehicle_part"]),
        (coverage, depth, classes, nearest),
    )
    half = 0.5 / np.sqrt(rule.number)
    np.minimum(coverage, 1.0, out=coverage)
    return Body(coverage[..., 0], coverage[..., 1], depth, classes, nearest <= (1.5 * half) ** 2)


@njit(cache=True, nogil=True)
def _see(raster: Any, rule: Any, surface: Any, ids: Any, found: Any) -> None:
    face_ids, planes, x0, y0, margin = raster
    columns, rows, shifts, table = rule
    uvs, mask, kinds = surface
    paint_id, other_id = ids
    coverage, depth, classes, nearest = found
    height, width = depth.shape
    reach = (table.shape[0] // rows - 1) // 2
    for i in range(face_ids.shape[0]):
        for j in range(face_ids.shape[1]):
            face = face_ids[i, j]
            if face < 0:
                continue
            row, column = y0 + i, x0 + j  # in samples, margin included
            x = (column + shifts[row % rows]) / columns - margin
            y = (row + 0.5) / rows - margin
            plane = planes[face]
            total = u = v = 0.0
            for k in range(3):
                share = max(plane[0, k] * x + plane[1, k] * y + plane[2, k], 0.0)
                total += share
                u += share * uvs[face, k, 0]
                v += share * uvs[face, k, 1]
            if total <= 0.0:
                continue
            kind, paint = kinds[face], 0.0
            if kind == paint_id:
                paint = bilinear_mask(mask, min(max(u / total, 0.0), 1.0), min(max(v / total, 0.0), 1.0))
                if paint <= 0.5:
                    kind = other_id
            down, across = row // rows - margin, column // columns - margin  # the sample's own pixel
            for r in range(max(down - reach, 0), min(down + reach, height - 1) + 1):
                for c in range(max(across - reach, 0), min(across + reach, width - 1) + 1):
                    weight = table[row - (r + margin - reach) * rows, column - (c + margin - reach) * columns]
                    coverage[r, c, 0] += weight
                    coverage[r, c, 1] += weight * paint
            if 0 <= down < height and 0 <= across < width:
                off = (x - across - 0.5) ** 2 + (y - down - 0.5) ** 2
                if off < nearest[down, across]:
                    nearest[down, across], depth[down, across] = off, 1.0 / total
                    classes[down, across] = kind
