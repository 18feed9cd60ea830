"""Boxes of samples around vertices and triangles, each as one vector of four integers.

A box is (-x0, -y0, x1, y1), all inclusive, in samples from the image's corner: the box around several is then the
greatest of each number. On a small picture of a car half of the triangles fall between the samples, and choosing the
others took longest of all: so three vertices are three loads, and nothing branches, since no processor can guess which.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, register_model
from numpy.typing import NDArray

from ..kernels import njit
from ..lanes import row_address
from .fixed_point import FRACTION, HALF, Screen, Window

NOTHING = -(2**30)  # of all four numbers: a box that no other is changed by

_WORD = ir.IntType(32)
_VECTOR = ir.VectorType(_WORD, 4)


def place_vertices(fixed: NDArray[np.int32], screen: Screen) -> NDArray[np.int32]:
    """What each vertex (2, V) in fixed point adds to the box of a triangle: (V, 4), within the image.

    Every vertex belongs to several triangles, so this is not asked per corner.
    """
    boxes = np.empty((fixed.shape[1], 4), np.int32)
    _place(fixed, screen.columns, screen.rows, screen.shifts.min(), screen.shifts.max(), screen.limits, boxes)
    return boxes


def select(corners: NDArray[np.int32], boxes: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32], Window]:
    """Triangles (T, 3) of vertices with ``boxes`` (V, 4) whose own box holds a sample.

    Returns:
        which they are (L,), their boxes (L + 1, 4), the last of no meaning, and the window of all of them.
    """
    live, around = np.empty(len(corners) + 1, np.int32), np.empty((len(corners) + 1, 4), np.int32)
    window = np.full((1, 4), NOTHING, np.int32)
    number = _select(corners, boxes, live, around, window)
    left, top, right, bottom = window[0].tolist()
    return live[:number], around, (-left, -top, right + 1, bottom + 1) if number else (0, 0, 0, 0)


@njit(cache=True, nogil=True)
def first(position: Any, per_pixel: Any, offset: Any) -> Any:
    """The first sample at or after a fixed-point position, where sample n lies at (n * ONE + offset) // per_pixel."""
    return -((offset - position * per_pixel) >> FRACTION)


@njit(cache=True, nogil=True)
def last(position: Any, per_pixel: Any, offset: Any) -> Any:
    """The last sample at or before a fixed-point position."""
    return ((position + 1) * per_pixel - 1 - offset) >> FRACTION


@njit(cache=True, nogil=True)
def _place(fixed: Any, columns: int, rows: int, low: int, high: int, limits: Any, boxes: Any) -> None:
    xs, ys = fixed[0], fixed[1]
    for v in range(xs.shape[0]):
        x, y = np.int64(xs[v]), np.int64(ys[v])
        boxes[v, 0], boxes[v, 1] = min(-first(x, columns, high), -limits[0]), min(-first(y, rows, HALF), -limits[1])
        boxes[v, 2], boxes[v, 3] = min(last(x, columns, low), limits[2] - 1), min(last(y, rows, HALF), limits[3] - 1)


@njit(cache=True, nogil=True)
def _select(corners: Any, boxes: Any, live: Any, around: Any, window: Any) -> int:
    number = np.uint64(0)
    none = whole = load_box(window, 0)
    for t in range(np.uint64(corners.shape[0])):
        box = join(load_box(boxes, corners[t, 0]), join(load_box(boxes, corners[t, 1]), load_box(boxes, corners[t, 2])))
        hit = holds(box)
        live[number] = t
        store_box(around, number, box)
        whole = join(whole, either(hit, box, none))
        number += np.uint64(hit)
    store_box(window, 0, whole)
    return int(number)


class _Box(types.Type):
    def __init__(self) -> None:
        super().__init__(name="Box")


@register_model(_Box)
class _BoxModel(models.PrimitiveModel):
    def __init__(self, manager: Any, box: _Box) -> None:
        super().__init__(manager, box, _VECTOR)


_BOX = _Box()


@intrinsic  # numba passes the first argument of each itself
def _load_box(_context: Any, array: Any, row: Any) -> Any:
    """Row ``row`` of an array (N, 4) int32. ``row`` must lie inside."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array_type, row_type = signature.args
        address = row_address(context, builder, array_type, arguments[0], row_type, arguments[1])
        return builder.load(builder.inttoptr(address, ir.PointerType(_VECTOR)), align=4)

    return _BOX(array, row), generate


@intrinsic
def _store_box(_context: Any, array: Any, row: Any, box: Any) -> Any:
    """``array[row] = box``. ``row`` must lie inside."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array_type, row_type, _ = signature.args
        address = row_address(context, builder, array_type, arguments[0], row_type, arguments[1])
        builder.store(arguments[2], builder.inttoptr(address, ir.PointerType(_VECTOR)), align=4)
        return context.get_dummy_value()

    return types.void(array, row, box), generate


@intrinsic
def _join_box(_context: Any, one: Any, two: Any) -> Any:
    """The box around two."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        one, two = arguments
        return builder.select(builder.icmp_signed(">", one, two), one, two)

    return _BOX(one, two), generate


@intrinsic
def _either_box(_context: Any, condition: Any, one: Any, two: Any) -> Any:
    """``one if condition else two``, without a branch."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.select(*arguments)

    return _BOX(condition, one, two), generate


@intrinsic
def _holds_box(_context: Any, box: Any) -> Any:
    """Whether a box holds a sample: neither x1 - x0 nor y1 - y0 is negative."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        halves = [ir.Constant(ir.VectorType(_WORD, 2), lanes) for lanes in ([0, 1], [2, 3])]
        low, high = (builder.shuffle_vector(arguments[0], arguments[0], half) for half in halves)
        lengths = builder.add(low, high)
        x, y = (builder.extract_element(lengths, _WORD(lane)) for lane in range(2))
        return builder.icmp_signed(">=", builder.or_(x, y), _WORD(0))

    return types.boolean(box), generate


load_box: Any = _load_box
store_box: Any = _store_box
join: Any = _join_box
either: Any = _either_box
holds: Any = _holds_box
