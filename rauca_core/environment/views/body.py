"""What a camera sees of the vehicle itself: coverage, depth and parts, rasterized from its mesh."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera, Vehicle
from ...contract.semantics import CLASS_IDS
from ...render import rasterize
from ...render.raster.pattern import Pattern, filter_table, pattern
from ...render.surface import bilinear_mask
from ...runtime.kernels import njit

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


def see_body(vehicle: Vehicle, camera_in_vehicle: Camera) -> Body:
    """Rasterize one view of a vehicle; ``camera_in_vehicle`` is in the vehicle's own frame."""
    rule = pattern(SAMPLES)
    table, reach = filter_table("blackman-harris", rule)
    raster = rasterize(vehicle.positions, vehicle.triangles, camera_in_vehicle, margin=reach, pattern=rule)
    height, width = camera_in_vehicle.height, camera_in_vehicle.width
    coverage, depth = np.zeros((height, width, 2), np.float32), np.zeros((height, width), np.float32)
    classes, center = np.zeros((height, width), np.uint8), np.zeros((height, width), np.bool_)
    _see(
        (raster.face_ids, raster.planes, raster.x0, raster.y0, raster.margin),
        (rule.columns, rule.rows, rule.shifts, table, _inwards(rule)),
        _surface(vehicle),
        (CLASS_IDS["paint"], CLASS_IDS["vehicle_part"]),
        (coverage, depth, classes, center),
    )
    np.minimum(coverage, 1.0, out=coverage)
    return Body(coverage[..., 0], coverage[..., 1], depth, classes, center)


@lru_cache(maxsize=4)
def _surface(vehicle: Vehicle) -> tuple[NDArray[np.float64], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.int8]]:
    """What the kernel asks of a vehicle's faces: uvs, mask, class of each, and how its mask is (see `_masks`)."""
    kinds = np.array([CLASS_IDS[_CLASSES.get(m.kind, "vehicle_part")] for m in vehicle.materials], np.uint8)
    uvs, of_face = vehicle.uvs.astype(np.float64), kinds[vehicle.material]
    return uvs, vehicle.paint_mask, of_face, _masks(uvs, vehicle.paint_mask, of_face == CLASS_IDS["paint"])


def _inwards(rule: Pattern) -> NDArray[np.int64]:
    """A pixel's samples, row by row, from the nearest to its center outwards: (number, 3) row, column and whether it
    stands for the center."""
    away = ((rule.points() - 0.5) ** 2).sum(1)
    order = np.argsort(away, kind="stable")
    half = 0.5 / np.sqrt(rule.number)
    return np.stack([order // rule.columns, order % rule.columns, away[order] <= (1.5 * half) ** 2], 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _masks(uvs: Any, mask: Any, painted: Any) -> Any:
    """Per face 1 where the whole of it is paint, 0 where none is, -1 where the mask must be asked at every sample."""
    height, width = mask.shape
    found = np.zeros(uvs.shape[0], np.int8)
    for face in range(uvs.shape[0]):
        if not painted[face]:
            continue
        x, y = uvs[face, :, 0] * width - 0.5, (1.0 - uvs[face, :, 1]) * height - 0.5
        left, right = int(max(min(np.floor(x.min()), width - 1), 0)), int(max(min(np.ceil(x.max()), width - 1), 0))
        top, bottom = int(max(min(np.floor(y.min()), height - 1), 0)), int(max(min(np.ceil(y.max()), height - 1), 0))
        low, high = 255, 0
        for r in range(top, bottom + 1):
            for c in range(left, right + 1):
                low, high = min(low, mask[r, c]), max(high, mask[r, c])
        found[face] = 1 if low == 255 else (0 if high == 0 else -1)
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _see(raster: Any, rule: Any, surface: Any, ids: Any, found: Any) -> None:
    """Pixel by pixel; one whose samples are all alike spreads over its neighbors as a whole, not sample by sample."""
    face_ids, planes, x0, y0, margin = raster
    columns, rows, shifts, table, inwards = rule
    (paint_id, other_id), masks = ids, surface[3]
    coverage, depth, classes, center = found
    height, width = depth.shape
    reach = (table.shape[0] // rows - 1) // 2
    side = 2 * reach + 1
    whole = np.zeros((side, side))
    for i in range(table.shape[0]):
        for j in range(table.shape[1]):
            whole[i // rows, j // columns] += table[i, j]
    shown, paints = np.zeros((rows, columns), np.bool_), np.zeros((rows, columns))
    for down in range(y0 // rows - margin, (y0 + face_ids.shape[0] - 1) // rows - margin + 1):
        for across in range(x0 // columns - margin, (x0 + face_ids.shape[1] - 1) // columns - margin + 1):
            count, painted, inside = 0, 0.0, 0 <= down < height and 0 <= across < width
            for k in range(inwards.shape[0]):
                row, column = inwards[k, 0], inwards[k, 1]
                i, j = (down + margin) * rows + row - y0, (across + margin) * columns + column - x0
                shown[row, column] = False
                if i < 0 or j < 0 or i >= face_ids.shape[0] or j >= face_ids.shape[1] or face_ids[i, j] < 0:
                    continue
                face = face_ids[i, j]
                paint, total = float(masks[face]), 1.0
                if paint < 0.0 or (inside and count == 0):
                    x, y = across + (column + shifts[row]) / columns, down + (row + 0.5) / rows
                    paint, total = _paint(surface, planes[face], face, x, y)
                    if total <= 0.0:
                        continue
                if inside and count == 0:
                    kind = surface[2][face]
                    classes[down, across] = other_id if kind == paint_id and paint <= 0.5 else kind
                    depth[down, across], center[down, across] = 1.0 / total, inwards[k, 2] == 1
                shown[row, column], paints[row, column] = True, paint
                count, painted = count + 1, painted + paint
            if count == 0:
                continue
            alike = count == rows * columns and (painted == 0.0 or painted == count)
            for r in range(max(down - reach, 0), min(down + reach, height - 1) + 1):
                for c in range(max(across - reach, 0), min(across + reach, width - 1) + 1):
                    up, left = down - r + reach, across - c + reach  # of the filter around (r, c), in pixels
                    if alike:
                        coverage[r, c, 0] += whole[up, left]
                        coverage[r, c, 1] += whole[up, left] * (painted / count)
                        continue
                    for row in range(rows):
                        for column in range(columns):
                            if shown[row, column]:
                                weight = table[up * rows + row, left * columns + column]
                                coverage[r, c, 0] += weight
                                coverage[r, c, 1] += weight * paints[row, column]


@njit(cache=True, nogil=True, error_model="numpy")
def _paint(surface: Any, plane: Any, face: Any, x: float, y: float) -> tuple[float, float]:
    """Share of paint at a sample, and 1 / depth."""
    uvs, mask, _, masks = surface
    total = u = v = 0.0
    for k in range(3):
        share = max(plane[0, k] * x + plane[1, k] * y + plane[2, k], 0.0)
        total += share
        u += share * uvs[face, k, 0]
        v += share * uvs[face, k, 1]
    if masks[face] >= 0 or total <= 0.0:
        return float(masks[face]), total
    return bilinear_mask(mask, min(max(u / total, 0.0), 1.0), min(max(v / total, 0.0), 1.0)), total
