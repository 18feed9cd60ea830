"""From the nodes of a TensorFlow graph to layers.

Only what the outputs need is read. Values are NHWC in the graph and NCHW here; nodes that only meet constants (batch
norms written out, the anchor generator) are evaluated on the spot.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import RaucaError
from .network import (
    IMAGE,
    Activation,
    ActivationKind,
    Affine,
    Concat,
    Convolution,
    Layer,
    Mean,
    Permute,
    Product,
    Reshape,
    Softmax,
    Sum,
)
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


def _concatenate(node: Node, *inputs: Array) -> Array:
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
    "ConcatV2": _concatenate,
    "Slice": _slice,
    "StridedSlice": _strided_slice,
    "Fill": _fill,
    "Tile": _tile,
    "Range": _range,
}


MAX_CONSTANTS = 2**27  # half a GiB; the largest of these graphs holds 30 million, each read twice
MAX_STEP = 64  # of strides, dilations and kernels: SAME padding would grow without bound


@dataclass(frozen=True)
class Value:
    """What a node stands for: a constant, or a layer's value with its channels (None: rows, behind a head)."""

    constant: NDArray[Any] | None = None
    layer: str = ""
    channels: int | None = None


def to_layers(nodes: dict[str, Node], image: str, outputs: Iterable[str]) -> tuple[list[Layer], dict[str, Value]]:
    """Layers in an order of computation, and what each visited node stands for.

    Args:
        image: the node that stands for the normalized image.
        outputs: the nodes to compute.

    Raises:
        RaucaError: a missing or unknown node, a cycle, shapes that do not fit.
    """
    builder = _Builder(nodes, image)
    for node in _in_order(nodes, image, outputs):
        builder.add(node)
    return builder.layers, builder.values


def _in_order(nodes: dict[str, Node], image: str, outputs: Iterable[str]) -> Iterator[Node]:
    """Every node that the outputs need, each after those it reads. No recursion: a graph may be a long chain."""
    finished, open_ = {image}, set[str]()
    stack = list(outputs)
    while stack:
        name = stack[-1]
        if name in finished:
            stack.pop()
            continue
        if name not in nodes:
            path = next(iter(nodes.values())).path
            raise RaucaError(f"{path}: node {name} is missing; no SSD graph of the TensorFlow object detection API")
        waiting = [source for source in nodes[name].inputs if source not in finished]
        if waiting:
            if name in open_:  # met again before what it reads is finished
                nodes[name].fail("is part of a cycle")
            open_.add(name)
            stack += waiting
            continue
        stack.pop()
        open_.discard(name)
        finished.add(name)
        yield nodes[name]


class _Builder:
    def __init__(self, nodes: dict[str, Node], image: str) -> None:
        self.nodes = nodes
        self.layers: list[Layer] = []
        self.values = {image: Value(layer=IMAGE, channels=3)}
        self.elements = 0

    def add(self, node: Node) -> None:
        inputs = [self.values[name] for name in node.inputs]
        constants = [value.constant for value in inputs if value.constant is not None]
        if node.op == "Const":
            self.values[node.name] = Value(self._counted(node, node.tensor()))
        elif inputs and len(constants) == len(inputs):
            self.values[node.name] = Value(self._counted(node, evaluate(node, constants)))
        elif node.op in _OPERATORS:
            self.values[node.name] = _OPERATORS[node.op](self, node, inputs)
        else:
            node.fail(f"is not supported; known operators are {', '.join(sorted(_OPERATORS))}")

    def _counted(self, node: Node, value: NDArray[Any]) -> NDArray[Any]:
        """Constants are kept to the end: a few bytes each may say how large they are."""
        self.elements += value.size
        if self.elements > MAX_CONSTANTS:
            node.fail(f"makes more than {MAX_CONSTANTS} constants in all; too large a graph")
        return value

    def emit(self, layer: Layer, channels: int | None) -> Value:
        self.layers.append(layer)
        return Value(layer=layer.name, channels=channels)


def _image(node: Node, inputs: list[Value], index: int = 0) -> tuple[str, int]:
    """Layer and channels of an input that must be an image."""
    if len(inputs) <= index or inputs[index].channels is None:
        node.fail(f"needs an image as input {index}")
    return inputs[index].layer, inputs[index].channels or 0


def _constant(node: Node, inputs: list[Value], index: int) -> NDArray[Any]:
    value = inputs[index].constant if index < len(inputs) else None
    if value is None:
        node.fail(f"needs a constant as input {index}")
    if value.dtype.kind == "f" and not np.isfinite(value).all():
        node.fail(f"reads values that are not finite (input {index}); the file is damaged")
    return value


def _convolution(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    source, channels = _image(node, inputs)
    kernel = _constant(node, inputs, 1).astype(np.float64)
    stride, dilation = _spatial(node, "strides"), _spatial(node, "dilations")
    padding = {"SAME": None, "VALID": (0, 0)}
    if node.text("padding", "") not in padding:
        node.fail(f"pads {node.text('padding', '')!r}; known are SAME and VALID")
    if kernel.ndim != 4 or kernel.shape[2] != channels or max(kernel.shape[:2]) > MAX_STEP or not kernel.size:
        node.fail(f"has a kernel of shape {kernel.shape} for an image of {channels} channels")
    groups = channels if node.op == "DepthwiseConv2dNative" else 1
    if groups > 1:  # (rows, columns, channels, multiplier): the filters of one channel lie together
        kernel = kernel.reshape(*kernel.shape[:2], 1, -1)
    kernel = kernel.transpose(3, 2, 0, 1)
    bias = np.zeros(len(kernel))
    layer = Convolution(node.name, (source,), kernel, bias, stride, dilation, padding[node.text("padding", "")], groups)
    return builder.emit(layer, len(kernel))


def _spatial(node: Node, name: str) -> tuple[int, int]:
    """The two middle numbers of an NHWC attribute; the outer ones must be 1."""
    values = node.integers(name, [1, 1, 1, 1])
    if node.text("data_format", "NHWC") != "NHWC":
        node.fail("is not laid out as NHWC")
    if len(values) != 4 or values[0] != 1 or values[3] != 1 or not all(1 <= v <= MAX_STEP for v in values):
        node.fail(f"has {name} {values}; expected [1, rows, columns, 1] up to {MAX_STEP}")
    return values[1], values[2]


def _arithmetic(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    """Sum or product of two values, or an affine map when one of them is constant."""
    if len(inputs) != 2:
        node.fail(f"has {len(inputs)} inputs, expected 2")
    if all(value.constant is None for value in inputs):
        return _of_two(builder, node, inputs)
    index = 0 if inputs[0].constant is not None else 1
    value = inputs[1 - index]
    constant = _constant(node, inputs, index).astype(np.float64)
    one, zero = np.ones(()), np.zeros(())
    match node.op:
        case "Mul":
            scale, shift = constant, zero
        case "RealDiv" if index == 1 and constant.all():
            scale, shift = 1 / constant, zero
        case "Add" | "AddV2" | "BiasAdd":
            scale, shift = one, constant
        case "Sub":
            scale, shift = (one, -constant) if index == 1 else (-one, constant)
        case _:
            node.fail("divides by a value of the image or by zero, which is not supported")
    scale, shift = (_per_channel(node, part, value.channels) for part in (scale, shift))
    return builder.emit(Affine(node.name, (value.layer,), scale, shift), value.channels)


def _of_two(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    sources = tuple(value.layer for value in inputs)
    channels = {value.channels for value in inputs}
    if len(channels) != 1 or None in channels:
        node.fail(f"joins images of different channels ({', '.join(str(value.channels) for value in inputs)})")
    if node.op in ("Add", "AddV2"):
        return builder.emit(Sum(node.name, sources), inputs[0].channels)
    if node.op == "Mul":
        return builder.emit(Product(node.name, sources), inputs[0].channels)
    node.fail("of two images is not supported; known are Add, AddV2 and Mul")


def _per_channel(node: Node, values: NDArray[Any], channels: int | None) -> NDArray[np.float64]:
    flat = values.astype(np.float64).reshape(-1)
    if flat.size == 1:
        return flat.reshape(())
    if channels is None or flat.size != channels or values.shape[-1] != channels:
        node.fail(f"applies a constant of shape {values.shape} to a value of {channels} channels")
    return flat


def _batch_norm(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    source, channels = _image(node, inputs)
    if node.flag("is_training", True):
        node.fail("is in training mode; freeze the graph for inference")
    gamma, beta, mean, variance = (_constant(node, inputs, k).astype(np.float64) for k in range(1, 5))
    if any(part.shape != (channels,) for part in (gamma, beta, mean, variance)):
        node.fail(f"has statistics of shape {gamma.shape} for {channels} channels")
    scale = gamma / np.sqrt(np.maximum(variance, 0.0) + node.number("epsilon"))
    if not np.isfinite(scale).all():
        node.fail("divides by a variance of 0")
    return builder.emit(Affine(node.name, (source,), scale, beta - mean * scale), channels)


def _activation(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    kinds: dict[str, ActivationKind] = {"Relu": "relu", "Relu6": "relu6", "Sigmoid": "sigmoid"}
    value = _only(node, inputs)
    return builder.emit(Activation(node.name, (value.layer,), kinds[node.op]), value.channels)


def _only(node: Node, inputs: list[Value]) -> Value:
    if not inputs or inputs[0].constant is not None:
        node.fail("needs a value of the image as its input")
    return inputs[0]


def _softmax(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    value = _only(node, inputs)
    return builder.emit(Softmax(node.name, (value.layer,), 1 if value.channels else 2), value.channels)


def _mean(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    source, channels = _image(node, inputs)
    axes = sorted(_constant(node, inputs, 1).reshape(-1).tolist())
    if axes != [1, 2] or not node.flag("keep_dims", False):
        node.fail(f"averages over axes {axes}; only rows and columns, kept as 1 x 1, are supported")
    return builder.emit(Mean(node.name, (source,)), channels)


def _head(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    """A head's image (B, rows, columns, anchors * K) becomes rows (B, N, K)."""
    source, channels = _image(node, inputs)
    constant = _constant(node, inputs, 1).reshape(-1)
    shape = constant.tolist()
    if (
        constant.dtype.kind != "i"
        or len(shape) not in (3, 4)
        or shape[-1] < 1
        or channels % shape[-1]
        or (len(shape) == 4 and shape[2] != 1)
    ):
        node.fail(f"reshapes {channels} channels to {shape}; expected (batch, anchors, [1,] values)")
    builder.emit(Permute(f"{node.name}:nhwc", (source,), (0, 2, 3, 1)), None)
    return builder.emit(Reshape(node.name, (f"{node.name}:nhwc",), (0, -1, shape[-1])), None)


def _concat(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    if len(inputs) < 2:
        node.fail(f"has {len(inputs)} inputs, expected the rows of heads and an axis")
    *parts, axis = inputs
    if axis.constant is None or axis.constant.tolist() != 1 or any(p.layer == "" or p.channels for p in parts):
        node.fail("joins something else than the rows of heads")
    return builder.emit(Concat(node.name, tuple(part.layer for part in parts), 1), None)


def _same_value(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    return _only(node, inputs)


def _squeeze(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    """Of rows' extent of 1, which :func:`_head` has left out."""
    if _only(node, inputs).channels is not None or node.integers("squeeze_dims", []) != [2]:
        node.fail("squeezes something else than the boxes of heads")
    return inputs[0]


def _shape(builder: _Builder, node: Node, inputs: list[Value]) -> Value:
    """Heads ask for the batch; :func:`_head` only reads the last extent of the shape they make of it."""
    return Value(np.full(4, UNKNOWN, np.int32))


_OPERATORS: dict[str, Callable[[_Builder, Node, list[Value]], Value]] = {
    "Conv2D": _convolution,
    "DepthwiseConv2dNative": _convolution,
    "Add": _arithmetic,
    "AddV2": _arithmetic,
    "BiasAdd": _arithmetic,
    "Sub": _arithmetic,
    "Mul": _arithmetic,
    "RealDiv": _arithmetic,
    "FusedBatchNorm": _batch_norm,
    "FusedBatchNormV2": _batch_norm,
    "FusedBatchNormV3": _batch_norm,
    "Relu": _activation,
    "Relu6": _activation,
    "Sigmoid": _activation,
    "Softmax": _softmax,
    "Mean": _mean,
    "Reshape": _head,
    "ConcatV2": _concat,
    "Identity": _same_value,
    "Squeeze": _squeeze,
    "Shape": _shape,
}
