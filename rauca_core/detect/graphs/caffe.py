"""Caffe's SSDs, without caffe: from a network's description and weights to layers, anchors and a detector."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import RaucaError
from .caffe_file import Block, read_blobs, read_prototxt
from .network import IMAGE, Activation, Affine, Array, Concat, Convolution, Layer, Permute, Reshape, Softmax
from .ssd import SsdDetector, SsdParts

PRIOR_OPTIONS = frozenset(
    {"min_size", "max_size", "aspect_ratio", "flip", "clip", "variance", "step", "step_h", "step_w", "offset"}
)


def prior_boxes(options: Block, extent: tuple[int, int], size: int) -> Array:
    """Anchors of one feature map, cell by cell in rows: (N, 4) center x, y, width, height, relative to the image.

    Args:
        options: ``prior_box_param``.
        extent: (rows, columns) of the feature map.
        size: of the square image, pixels.
    """
    sizes = _sizes(options)
    rows, columns = extent
    step = options.numbers("step") * 2 or [*options.numbers("step_h"), *options.numbers("step_w")]
    if len(step) not in (0, 2) or min(step, default=1) <= 0:
        options.fail("needs one positive step, or both step_h and step_w, or none of them")
    step_rows, step_columns = step or (size / rows, size / columns)
    offset = options.numbers("offset", [0.5])[0]
    y, x = np.meshgrid(
        (np.arange(rows) + offset) * step_rows, (np.arange(columns) + offset) * step_columns, indexing="ij"
    )
    centers = np.repeat(np.stack([x, y], -1).reshape(-1, 1, 2), len(sizes), axis=1)
    extents = np.broadcast_to(sizes, centers.shape)
    boxes = np.concatenate([centers, extents], -1).reshape(-1, 4) / size
    return _clipped(boxes) if options.flag("clip", False) else boxes


def variances(options: Block) -> Array:
    """(4,) factors on the encoded center x, y, width, height."""
    values = options.numbers("variance", [0.1])
    if len(values) not in (1, 4) or min(values) <= 0:
        options.fail(f"has variances {values}, expected one or four positive numbers")
    return np.broadcast_to(np.array(values, np.float64), 4)


def _sizes(options: Block) -> Array:
    """(K, 2) widths and heights of the anchors of one cell, pixels, in caffe's order."""
    smallest, largest = options.numbers("min_size"), options.numbers("max_size")
    ratios: list[float] = []
    for ratio in options.numbers("aspect_ratio"):
        for wanted in (ratio, 1 / ratio if ratio > 0 and options.flag("flip", True) else ratio):
            if not any(math.isclose(wanted, known, abs_tol=1e-6) for known in [1.0, *ratios]):
                ratios.append(wanted)
    if not smallest or min([*smallest, *ratios, *largest]) <= 0 or len(largest) not in (0, len(smallest)):
        options.fail("needs positive sizes and aspect ratios, and as many max_size as min_size or none")
    sizes = []
    for number, low in enumerate(smallest):
        sizes.append((low, low))
        if largest:
            sizes.append((math.sqrt(low * largest[number]),) * 2)
        sizes += [(low * math.sqrt(ratio), low / math.sqrt(ratio)) for ratio in ratios]
    return np.array(sizes)


def _clipped(boxes: Array) -> Array:
    low, high = (boxes[:, :2] + sign * boxes[:, 2:] / 2 for sign in (-1, 1))
    low, high = low.clip(0, 1), high.clip(0, 1)
    return np.concatenate([(low + high) / 2, high - low], axis=1)


MAX_SIZE = 2048
MAX_STEP = 64
_EVERYWHERE = frozenset({"name", "type", "bottom", "top", "param", "include", "phase"})
_CONVOLUTION = frozenset({"num_output", "pad", "kernel_size", "stride", "group", "dilation", "bias_term"})
_TRAINING = frozenset({"weight_filler", "bias_filler", "filler", "engine", "moving_average_fraction"})


@dataclass(frozen=True)
class Value:
    """What a blob holds: an image with its channels and (rows, columns), something later, or anchors."""

    layer: str = ""
    channels: int | None = None
    extent: tuple[int, int] = (0, 0)
    anchors: Array | None = None
    variances: Array | None = None


@dataclass(frozen=True)
class Output:
    """What ``DetectionOutput`` reads: the values with encodings and scores, and the anchors."""

    boxes: Value
    scores: Value
    anchors: Value
    columns: int


class Builder:
    """Takes a network's layers in their order.

    Attributes:
        size: of the square input, pixels.
        layers: in an order of computation.
        output: known after the ``DetectionOutput`` layer.
    """

    def __init__(self, network: Block, blobs: dict[str, list[NDArray[Any]]], weights: Path) -> None:
        """Build everything.

        Raises:
            RaucaError: an unknown layer or option, shapes that do not fit, weights of another network.
        """
        self.blobs, self.weights = blobs, weights
        self.layers: list[Layer] = []
        self.values: dict[str, Value] = {}
        self.size = 0
        self.output: Output | None = None
        network.only(frozenset({"name", "input", "input_shape", "input_dim", "layer"}))
        self._declared_input(network)
        names = set[str]()
        for block in network.blocks.get("layer", []):
            block.kind = f"layer {block.text('name')} ({block.text('type')})"
            if block.text("name") in names:
                block.fail("has the name of another layer")
            names.add(block.text("name"))
            if all(include.text("phase", "TEST") == "TEST" for include in block.blocks.get("include", [])):
                self._add(block)

    def _declared_input(self, network: Block) -> None:
        """``input`` outside of any layer, the older of caffe's two ways."""
        if "input" in network.values:
            shape = network.block("input_shape").integers("dim") or network.integers("input_dim")
            self._set_input(network, network.text("input"), shape)

    def _set_input(self, block: Block, top: str, shape: list[int]) -> None:
        if len(shape) != 4 or shape[1] != 3 or shape[2] != shape[3] or not 1 <= shape[2] <= MAX_SIZE or self.size:
            block.fail(f"takes an input of shape {shape}; expected one, (batch, 3, size, size) up to {MAX_SIZE}")
        self.size = shape[2]
        self.values[top] = Value(IMAGE, 3, (self.size, self.size))

    def _add(self, block: Block) -> None:
        kind = block.text("type")
        if kind == "Input":
            self._set_input(block, block.text("top"), block.block("input_param").block("shape").integers("dim"))
            return
        if kind not in _LAYERS:
            block.fail(f"is not supported; known layers are {', '.join(sorted(_LAYERS))}")
        parameter, options, function = _LAYERS[kind]
        block.only(_EVERYWHERE | {parameter})
        chosen = block.block(parameter)
        chosen.kind = block.kind
        chosen.only(options | _TRAINING)
        inputs = [self._value(block, name) for name in block.values.get("bottom", [])]
        if not inputs:
            block.fail("reads nothing")
        self.values[block.text("top")] = function(self, chosen, block.text("name"), inputs)

    def _value(self, block: Block, name: str) -> Value:
        if name not in self.values:
            block.fail(f"reads {name}, which no layer before it makes")
        return self.values[name]

    def take(self, block: Block, name: str, shapes: list[tuple[int, ...]]) -> list[Array]:
        """The weights of a layer as float64, if they are what its description wants."""
        blobs = self.blobs.get(name, [])
        found = [blob.shape for blob in blobs]
        if [_trim(shape) for shape in found] != [_trim(shape) for shape in shapes]:
            holds = ", ".join(str(shape) for shape in found) or "nothing"
            wants = ", ".join(str(shape) for shape in shapes)
            raise RaucaError(
                f"{self.weights}: holds {holds} for the {block.kind} of {block.path.name}, which takes {wants}; "
                "these are the weights of another network"
            )
        return [blob.astype(np.float64).reshape(shape) for blob, shape in zip(blobs, shapes, strict=True)]

    def emit(self, layer: Layer, channels: int | None = None, extent: tuple[int, int] = (0, 0)) -> Value:
        self.layers.append(layer)
        return Value(layer.name, channels, extent)


def _trim(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Old files write (1, 1, 1, C) for (C,)."""
    start = next((axis for axis, extent in enumerate(shape) if extent != 1), len(shape))
    return shape[start:]


def _image(block: Block, inputs: list[Value]) -> tuple[str, int, tuple[int, int]]:
    if len(inputs) != 1 or inputs[0].channels is None:
        block.fail("needs one image as its input")
    return inputs[0].layer, inputs[0].channels or 0, inputs[0].extent


def _layer(block: Block, inputs: list[Value]) -> str:
    """The layer behind the only input."""
    if len(inputs) != 1 or not inputs[0].layer:
        block.fail("needs one value of the image as its input")
    return inputs[0].layer


def _convolution(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    source, channels, extent = _image(block, inputs)
    out, groups = block.integer("num_output", minimum=1), block.integer("group", 1, 1)
    kernel = block.integer("kernel_size", minimum=1, maximum=MAX_STEP)
    pad = block.integer("pad", 0, maximum=MAX_STEP)
    stride, dilation = (block.integer(option, 1, 1, MAX_STEP) for option in ("stride", "dilation"))
    if channels % groups or out % groups:
        block.fail(f"has {groups} groups for {channels} channels in and {out} out")
    shapes: list[tuple[int, ...]] = [(out, channels // groups, kernel, kernel)]
    if block.flag("bias_term", True):
        shapes.append((out,))
    weight, *bias = builder.take(block, name, shapes)
    rows, columns = ((e + 2 * pad - dilation * (kernel - 1) - 1) // stride + 1 for e in extent)
    if min(rows, columns) < 1:
        block.fail(f"has a kernel larger than its image of {extent[0]} x {extent[1]}")
    layer = Convolution(
        name,
        (source,),
        weight,
        bias[0] if bias else np.zeros(out),
        (stride, stride),
        (dilation, dilation),
        (pad, pad),
        groups,
    )
    return builder.emit(layer, out, (rows, columns))


def _batch_norm(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    source, channels, extent = _image(block, inputs)
    if not block.flag("use_global_stats", True):
        block.fail("normalizes by its own batch; only stored statistics are supported")
    mean, variance, count = builder.take(block, name, [(channels,), (channels,), (1,)])
    factor = 0.0 if count[0] == 0 else 1 / count[0]  # caffe keeps sums and how much went into them
    scale = 1 / np.sqrt(np.maximum(variance * factor, 0.0) + block.numbers("eps", [1e-5])[0])
    return builder.emit(Affine(name, (source,), scale, -mean * factor * scale), channels, extent)


def _scale(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    source, channels, extent = _image(block, inputs)
    shapes: list[tuple[int, ...]] = [(channels,)] * (2 if block.flag("bias_term", False) else 1)
    scale, *shift = builder.take(block, name, shapes)
    return builder.emit(Affine(name, (source,), scale, shift[0] if shift else np.zeros(channels)), channels, extent)


def _relu(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    source, channels, extent = _image(block, inputs)
    if block.numbers("negative_slope", [0.0])[0] != 0.0:
        block.fail("leaks; only a negative_slope of 0 is supported")
    return builder.emit(Activation(name, (source,), "relu"), channels, extent)


def _permute(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    source, _, _ = _image(block, inputs)
    if block.integers("order") != [0, 2, 3, 1]:
        block.fail(f"permutes to {block.integers('order')}; only 0, 2, 3, 1 is supported")
    return builder.emit(Permute(name, (source,), (0, 2, 3, 1)))


def _flatten(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    if block.integer("axis", 1) != 1:
        block.fail("flattens from another axis than 1")
    return builder.emit(Reshape(name, (_layer(block, inputs),), (0, -1)))


def _reshape(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    shape = tuple(block.block("shape").integers("dim"))
    if not 1 <= len(shape) <= 4 or min(shape) < -1 or shape.count(-1) > 1:
        block.fail(f"reshapes to {shape}")
    return builder.emit(Reshape(name, (_layer(block, inputs),), shape))


def _softmax(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    return builder.emit(Softmax(name, (_layer(block, inputs),), block.integer("axis", 1, 1, 3)))


def _concat(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    axis = block.integer("axis", 1)
    anchors = [value.anchors for value in inputs if value.anchors is not None]
    if len(anchors) == len(inputs) and axis == 2:
        if len({tuple(value.variances) for value in inputs if value.variances is not None}) != 1:
            block.fail("joins anchors of different variances")
        return Value(anchors=np.concatenate(anchors), variances=inputs[0].variances)
    if anchors or axis != 1 or any(value.channels is not None for value in inputs):
        block.fail("joins something else than flat heads along axis 1, or anchors along axis 2")
    return builder.emit(Concat(name, tuple(value.layer for value in inputs), 1))


def _prior_box(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    if len(inputs) != 2 or inputs[0].channels is None or inputs[1].layer != IMAGE:
        block.fail("needs a feature map and the network's input")
    return Value(anchors=prior_boxes(block, inputs[0].extent, builder.size), variances=variances(block))


def _detection_output(builder: Builder, block: Block, name: str, inputs: list[Value]) -> Value:
    """Its suppression is replaced by this package's; the rest must be what the decoder does."""
    expected = {
        "code_type": (block.text("code_type", "CORNER"), "CENTER_SIZE"),
        "share_location": (block.flag("share_location", True), True),
        "background_label_id": (block.integer("background_label_id", 0), 0),
        "variance_encoded_in_target": (block.flag("variance_encoded_in_target", False), False),
    }
    for option, (found, wanted) in expected.items():
        if found != wanted:
            block.fail(f"has {option}: {found}; only {wanted} is supported")
    if len(inputs) != 3 or not inputs[0].layer or not inputs[1].layer or inputs[2].anchors is None or builder.output:
        block.fail("needs boxes, scores and anchors, and must be the only one")
    builder.output = Output(inputs[0], inputs[1], inputs[2], block.integer("num_classes", minimum=2))
    return Value()


_LayerFunction = Callable[[Builder, Block, str, list[Value]], Value]
_OUTPUT = frozenset(
    {
        *("num_classes", "share_location", "background_label_id", "variance_encoded_in_target", "code_type"),
        *("nms_param", "keep_top_k", "confidence_threshold"),
    }
)

# By type: the block with its options, the options known, and what makes a layer of it
_LAYERS: dict[str, tuple[str, frozenset[str], _LayerFunction]] = {
    "Convolution": ("convolution_param", _CONVOLUTION, _convolution),
    "BatchNorm": ("batch_norm_param", frozenset({"use_global_stats", "eps"}), _batch_norm),
    "Scale": ("scale_param", frozenset({"bias_term"}), _scale),
    "ReLU": ("relu_param", frozenset({"negative_slope"}), _relu),
    "Permute": ("permute_param", frozenset({"order"}), _permute),
    "Flatten": ("flatten_param", frozenset({"axis"}), _flatten),
    "Reshape": ("reshape_param", frozenset({"shape"}), _reshape),
    "Softmax": ("softmax_param", frozenset({"axis"}), _softmax),
    "Concat": ("concat_param", frozenset({"axis"}), _concat),
    "PriorBox": ("prior_box_param", PRIOR_OPTIONS, _prior_box),
    "DetectionOutput": ("detection_output_param", _OUTPUT, _detection_output),
}


# How MobileNet-SSD was trained: (BGR in 0 to 255 - 127.5) * 0.007843. A description for testing does not say it.
_SCALE = 0.007843
_NORMALISATION = (255.0 * _SCALE, -127.5 * _SCALE)


class CaffeSsdDetector(SsdDetector):
    """A caffe SSD, e.g. MobileNet-SSD for the classes of VOC, behind the detector interface.

    Scores are the network's softmax. The stretch to the network's square samples as OpenCV's resize does.
    """

    def __init__(self, name: str, prototxt: Path, weights: Path, class_names: tuple[str, ...]) -> None:
        """Read a network's description and its weights.

        Args:
            prototxt: the description for testing (deploy), in text.
            weights: the caffemodel.
            class_names: one per label from 1 on; 0 is the background.

        Raises:
            RaucaError: anything wrong with the files, weights of another network, class names of another number.
        """
        super().__init__(name, read_caffe_ssd(prototxt, weights), class_names, (prototxt, weights))


def read_caffe_ssd(prototxt: Path, weights: Path) -> SsdParts:
    """The parts of the SSD in a caffe network; see :class:`CaffeSsdDetector`."""
    built = Builder(read_prototxt(prototxt), read_blobs(weights), weights)
    output = built.output
    if output is None or output.anchors.anchors is None or output.anchors.variances is None:
        raise RaucaError(f"{prototxt}: has no DetectionOutput layer; this is no SSD for testing")
    return SsdParts(
        path=prototxt,
        layers=built.layers,
        boxes=output.boxes.layer,
        scores=output.scores.layer,
        anchors=output.anchors.anchors,
        variances=output.anchors.variances,
        columns=output.columns,
        normalization=_NORMALISATION,
        size=built.size,
        rows_first=False,
        blue_first=True,
        half_pixel_centers=True,
    )
