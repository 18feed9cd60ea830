"""From the nodes of a TensorFlow graph to layers.

Only what the outputs need is read. Values are NHWC in the graph and NCHW here; nodes that only meet constants (batch
norms written out, the anchor generator) are evaluated on the spot.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from graphlib import CycleError, TopologicalSorter
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import fx

from ...contract import RaucaError
from ..foreign import first_line
from .network import Activation, Affine, Builder, Convolution, reshape
from .tensorflow_file import MAX_ELEMENTS, Node

Array = NDArray[Any]
Value = fx.Node | Array  # a value of the image, (B, C, H, W) or rows (B, N, K), or a constant
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
        node.fail(f"does not fit its inputs ({first_line(error)})")


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
    kinds, wanted = {1: np.float32, 2: np.float64, 3: np.int32, 9: np.int64}, node.get("DstT", "type", 0)
    if wanted not in kinds:
        node.fail(f"casts to TensorFlow's type {wanted}; known are {sorted(kinds)}")
    return value.astype(kinds[wanted])


def _slice(node: Node, value: Array, begin: Array, size: Array) -> Array:
    ends = [None if s < 0 else b + s for b, s in zip(begin.tolist(), size.tolist(), strict=True)]
    return value[tuple(slice(b, e) for b, e in zip(begin.tolist(), ends, strict=True))]


def _strided_slice(node: Node, value: Array, begin: Array, end: Array, stride: Array) -> Array:
    masks = {name: node.get(f"{name}_mask", "i", 0) for name in ("begin", "end", "shrink_axis", "new_axis", "ellipsis")}
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
    "Pack": lambda node, *values: np.stack(values, node.get("axis", "i", 0)),
    "ConcatV2": lambda node, *inputs: np.concatenate(inputs[:-1], int(inputs[-1])),
    "Slice": _slice,
    "StridedSlice": _strided_slice,
    "Fill": _fill,
    "Tile": _tile,
    "Range": _range,
}


MAX_CONSTANTS = 2**27  # half a GiB; the largest of these graphs holds 30 million, each read twice
MAX_STEP = 64  # of strides, dilations and kernels: SAME padding would grow without bound


def to_layers(
    nodes: dict[str, Node], builder: Builder, name: str, image: fx.Node, outputs: Sequence[str]
) -> list[Value]:
    """Let ``builder`` make what the outputs need; returns their values.

    Args:
        name: of the node that stands for the normalized image.
        image: its value.
        outputs: the nodes to compute.

    Raises:
        RaucaError: a missing or unknown node, a cycle, shapes that do not fit.
    """
    values: dict[str, Value] = {name: image}
    elements = 0
    for node in _in_order(nodes, name, outputs):
        inputs = [values[source] for source in node.inputs]
        constants = [value for value in inputs if not isinstance(value, fx.Node)]
        if node.op == "Const" or (inputs and len(constants) == len(inputs)):
            made = node.tensor() if node.op == "Const" else evaluate(node, constants)
            elements += made.size  # constants are kept to the end: a few bytes each may say how large they are
            if elements > MAX_CONSTANTS:
                node.fail(f"makes more than {MAX_CONSTANTS} constants in all; too large a graph")
            values[node.name] = made
        elif node.op in _OPERATORS:
            try:
                values[node.name] = _OPERATORS[node.op](builder, node, inputs)
            except ValueError as error:
                node.fail(f"does not fit its inputs ({error})")
        else:
            node.fail(f"is not supported; known operators are {', '.join(sorted(_OPERATORS))}")
    return [values[output] for output in outputs]


def _in_order(nodes: dict[str, Node], image: str, outputs: Sequence[str]) -> list[Node]:
    """Every node that the outputs need, each after those it reads."""
    needed: dict[str, tuple[str, ...]] = {}
    waiting = list(outputs)
    while waiting:
        name = waiting.pop()
        if name == image or name in needed:
            continue
        if name not in nodes:
            path = next(iter(nodes.values())).path
            raise RaucaError(f"{path}: node {name} is missing; no SSD graph of the TensorFlow object detection API")
        needed[name] = nodes[name].inputs
        waiting += needed[name]
    try:
        return [nodes[name] for name in TopologicalSorter(needed).static_order() if name != image]
    except CycleError as error:
        nodes[error.args[1][0]].fail("is part of a cycle")


def _only(node: Node, inputs: Sequence[Value]) -> fx.Node:
    """The first input, a value of the image."""
    if not inputs or not isinstance(inputs[0], fx.Node):
        node.fail("needs a value of the image as its input")
    return inputs[0]


def _channels(value: fx.Node) -> int | None:
    """Of an image; None of rows."""
    shape = value.meta["value"].shape
    return int(shape[1]) if len(shape) == 4 else None


def _image(node: Node, inputs: Sequence[Value]) -> tuple[fx.Node, int]:
    """The first input and its channels."""
    image = _only(node, inputs)
    channels = _channels(image)
    if channels is None:
        node.fail("needs an image as input 0")
    return image, channels


def _constant(node: Node, inputs: Sequence[Value], index: int) -> Array:
    value = inputs[index] if index < len(inputs) else None
    if value is None or isinstance(value, fx.Node):
        node.fail(f"needs a constant as input {index}")
    if value.dtype.kind == "f" and not np.isfinite(value).all():
        node.fail(f"reads values that are not finite (input {index}); the file is damaged")
    return value


def _convolution(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    source, channels = _image(node, inputs)
    kernel = _constant(node, inputs, 1).astype(np.float64)
    stride, dilation = _spatial(node, "strides"), _spatial(node, "dilations")
    padding, given = {"SAME": None, "VALID": (0, 0)}, node.get("padding", "s", "")
    if given not in padding:
        node.fail(f"pads {given!r}; known are SAME and VALID")
    if kernel.ndim != 4 or kernel.shape[2] != channels or max(kernel.shape[:2]) > MAX_STEP or not kernel.size:
        node.fail(f"has a kernel of shape {kernel.shape} for an image of {channels} channels")
    groups = channels if node.op == "DepthwiseConv2dNative" else 1
    if groups > 1:  # (rows, columns, channels, multiplier): the filters of one channel lie together
        kernel = kernel.reshape(*kernel.shape[:2], 1, -1)
    kernel = kernel.transpose(3, 2, 0, 1)
    bias = np.zeros(len(kernel))
    return builder.add(Convolution(kernel, bias, stride, dilation, padding[given], groups), source)


def _spatial(node: Node, name: str) -> tuple[int, int]:
    """The two middle numbers of an NHWC attribute; the outer ones must be 1."""
    values = node.integers(name, [1, 1, 1, 1])
    if node.get("data_format", "s", "NHWC") != "NHWC":
        node.fail("is not laid out as NHWC")
    if len(values) != 4 or values[0] != 1 or values[3] != 1 or not all(1 <= v <= MAX_STEP for v in values):
        node.fail(f"has {name} {values}; expected [1, rows, columns, 1] up to {MAX_STEP}")
    return values[1], values[2]


def _arithmetic(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    """Sum or product of two values, or an affine map when one of them is constant."""
    if len(inputs) != 2:
        node.fail(f"has {len(inputs)} inputs, expected 2")
    first, second = inputs
    if isinstance(first, fx.Node) and isinstance(second, fx.Node):
        if node.op not in _OF_TWO:
            node.fail(f"of two images is not supported; known are {', '.join(_OF_TWO)}")
        return builder.add(_OF_TWO[node.op], first, second)
    value = first if isinstance(first, fx.Node) else second
    assert isinstance(value, fx.Node)  # constants alone were evaluated
    constant = _per_channel(node, _constant(node, inputs, inputs.index(value) ^ 1), _channels(value))
    match node.op:
        case "Mul":
            return builder.add(Affine(constant, 0.0), value)
        case "RealDiv" if value is first and constant.all():
            return builder.add(Affine(1 / constant, 0.0), value)
        case "Add" | "AddV2" | "BiasAdd":
            return builder.add(Affine(1.0, constant), value)
        case "Sub":
            return builder.add(Affine(1.0, -constant) if value is first else Affine(-1.0, constant), value)
    node.fail("divides by a value of the image or by zero, which is not supported")


_OF_TWO: dict[str, Callable[..., Any]] = {"Add": operator.add, "AddV2": operator.add, "Mul": operator.mul}


def _per_channel(node: Node, values: Array, channels: int | None) -> NDArray[np.float64]:
    flat = values.astype(np.float64).reshape(-1)
    if flat.size == 1:
        return flat.reshape(())
    if channels is None or flat.size != channels or values.shape[-1] != channels:
        node.fail(f"applies a constant of shape {values.shape} to a value of {channels} channels")
    return flat


def _batch_norm(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    source, channels = _image(node, inputs)
    if node.get("is_training", "b", True):
        node.fail("is in training mode; freeze the graph for inference")
    gamma, beta, mean, variance = (_constant(node, inputs, k).astype(np.float64) for k in range(1, 5))
    if any(part.shape != (channels,) for part in (gamma, beta, mean, variance)):
        node.fail(f"has statistics of shape {gamma.shape} for {channels} channels")
    scale = gamma / np.sqrt(np.maximum(variance, 0.0) + node.number("epsilon"))
    if not np.isfinite(scale).all():
        node.fail("divides by a variance of 0")
    return builder.add(Affine(scale, beta - mean * scale), source)


def _activation(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    return builder.add(Activation(node.op), _only(node, inputs))


def _softmax(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    value = _only(node, inputs)
    return builder.add(torch.softmax, value, 1 if _channels(value) else 2)


def _mean(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    source, _ = _image(node, inputs)
    axes = sorted(_constant(node, inputs, 1).reshape(-1).tolist())
    if axes != [1, 2] or not node.get("keep_dims", "b", False):
        node.fail(f"averages over axes {axes}; only rows and columns, kept as 1 x 1, are supported")
    return builder.add(torch.mean, source, (2, 3), keepdim=True)


def _head(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    """A head's image (B, rows, columns, anchors * K) becomes rows (B, N, K)."""
    source, channels = _image(node, inputs)
    constant = _constant(node, inputs, 1).reshape(-1)
    shape = constant.tolist()
    whole = constant.dtype.kind == "i" and len(shape) in (3, 4) and shape[-1] >= 1
    if not whole or channels % shape[-1] or shape[2:-1] not in ([], [1]):
        node.fail(f"reshapes {channels} channels to {shape}; expected (batch, anchors, [1,] values)")
    return builder.add(reshape, builder.add(torch.permute, source, (0, 2, 3, 1)), (0, -1, shape[-1]))


def _concat(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    if len(inputs) < 2:
        node.fail(f"has {len(inputs)} inputs, expected the rows of heads and an axis")
    *parts, axis = inputs
    rows = all(isinstance(part, fx.Node) and _channels(part) is None for part in parts)
    if isinstance(axis, fx.Node) or axis.tolist() != 1 or not rows:
        node.fail("joins something else than the rows of heads")
    return builder.add(torch.cat, parts, 1)


def _same_value(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    return _only(node, inputs)


def _squeeze(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    """Of rows' extent of 1, which :func:`_head` has left out."""
    value = _only(node, inputs)
    if _channels(value) is not None or node.integers("squeeze_dims", []) != [2]:
        node.fail("squeezes something else than the boxes of heads")
    return value


def _shape(builder: Builder, node: Node, inputs: list[Value]) -> Value:
    """Heads ask for the batch; :func:`_head` only reads the last extent of the shape they make of it."""
    return np.full(4, UNKNOWN, np.int32)


_OPERATORS: dict[str, Callable[[Builder, Node, list[Value]], Value]] = {
    **dict.fromkeys(("Conv2D", "DepthwiseConv2dNative"), _convolution),
    **dict.fromkeys(("Add", "AddV2", "BiasAdd", "Sub", "Mul", "RealDiv"), _arithmetic),
    **dict.fromkeys(("FusedBatchNorm", "FusedBatchNormV2", "FusedBatchNormV3"), _batch_norm),
    **dict.fromkeys(("Relu", "Relu6", "Sigmoid"), _activation),
    "Softmax": _softmax,
    "Mean": _mean,
    "Reshape": _head,
    "ConcatV2": _concat,
    "Identity": _same_value,
    "Squeeze": _squeeze,
    "Shape": _shape,
}
