"""The operators of a TensorFlow graph that only ever meet constants: batch norms written out, the anchor generator."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .tensorflow_file import MAX_ELEMENTS, Node

Array = NDArray[Any]
UNKNOWN = -1  # stands for an extent that depends on the image or the batch


def evaluate(node: Node, inputs: Sequence[Array]) -> Array:
    """The value of a node whose inputs are all known.

    Raises:
        RaucaError: an operator that is not known here, inputs that do not fit it, a value too large to hold.
    """
    if node.op not in CONSTANT_OPS:
        node.fail(f"is no operator of constants that is known; known are {', '.join(sorted(CONSTANT_OPS))}")
    try:
        with np.errstate(all="ignore"):  # what is not finite is refused where it is used
            return np.asarray(CONSTANT_OPS[node.op](node, *inputs))
    except (ValueError, TypeError, IndexError, OverflowError, ZeroDivisionError, MemoryError) as error:
        node.fail(f"does not fit its inputs ({str(error).splitlines()[0] if str(error) else type(error).__name__})")


def _sized(node: Node, count: float) -> None:
    if not count <= MAX_ELEMENTS:
        node.fail(f"would make {count:.0f} elements; at most {MAX_ELEMENTS} are made")


def _fill(node: Node, shape: Array, value: Array) -> Array:
    _sized(node, math.prod(shape.tolist()))
    return np.full(shape.tolist(), value)


def _tile(node: Node, value: Array, multiples: Array) -> Array:
    _sized(node, value.size * math.prod(multiples.tolist()))
    return np.tile(value, multiples.tolist())


def _range(node: Node, start: Array, limit: Array, delta: Array) -> Array:
    _sized(node, abs((float(limit) - float(start)) / float(delta)))
    return np.arange(start.item(), limit.item(), delta.item(), dtype=start.dtype)


def _cast(node: Node, value: Array) -> Array:
    kinds = {1: np.float32, 2: np.float64, 3: np.int32, 9: np.int64}
    if node.type("DstT") not in kinds:
        node.fail(f"casts to TensorFlow's type {node.type('DstT')}; known are {sorted(kinds)}")
    return value.astype(kinds[node.type("DstT")])


def _slice(node: Node, value: Array, begin: Array, size: Array) -> Array:
    ends = [None if s < 0 else b + s for b, s in zip(begin.tolist(), size.tolist(), strict=True)]
    return value[tuple(slice(b, e) for b, e in zip(begin.tolist(), ends, strict=True))]


def _strided_slice(node: Node, value: Array, begin: Array, end: Array, stride: Array) -> Array:
    masks = {name: node.integer(f"{name}_mask", 0) for name in ("begin", "end", "shrink_axis", "new_axis", "ellipsis")}
    if masks["new_axis"] or masks["ellipsis"]:
        node.fail("slices with a new axis or an ellipsis, which is not supported")
    index: list[int | slice] = []
    for axis, (b, e, s) in enumerate(zip(begin.tolist(), end.tolist(), stride.tolist(), strict=True)):
        bit = 1 << axis
        if masks["shrink_axis"] & bit:
            index.append(b)
        else:
            index.append(slice(None if masks["begin"] & bit else b, None if masks["end"] & bit else e, s))
    return np.asarray(value[tuple(index)])


def _concat(node: Node, *inputs: Array) -> Array:
    return np.concatenate(inputs[:-1], int(inputs[-1]))


def _broadcast(function: Callable[[Array, Array], Array]) -> Callable[[Node, Array, Array], Array]:
    def checked(node: Node, a: Array, b: Array) -> Array:
        _sized(node, math.prod(np.broadcast_shapes(a.shape, b.shape)))
        return function(a, b)

    return checked


CONSTANT_OPS: dict[str, Callable[..., Array]] = {
    "Add": _broadcast(np.add),
    "AddV2": _broadcast(np.add),
    "Sub": _broadcast(np.subtract),
    "Mul": _broadcast(np.multiply),
    "RealDiv": _broadcast(np.divide),
    "Minimum": _broadcast(np.minimum),
    "Maximum": _broadcast(np.maximum),
    "Sqrt": lambda node, value: np.sqrt(value),
    "Rsqrt": lambda node, value: 1 / np.sqrt(value),
    "Identity": lambda node, value: value,
    "Cast": _cast,
    "Reshape": lambda node, value, shape: value.reshape(shape.tolist()),
    "ExpandDims": lambda node, value, axis: np.expand_dims(value, int(axis)),
    "Pack": lambda node, *values: np.stack(values, node.integer("axis", 0)),
    "ConcatV2": _concat,
    "Slice": _slice,
    "StridedSlice": _strided_slice,
    "Fill": _fill,
    "Tile": _tile,
    "Range": _range,
}
