"""Caffe's SSDs, without caffe: from a network's description and weights to layers, anchors and a detector."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import torch
from numpy.typing import NDArray
from torch import fx

from ...contract import RaucaError
from ..families import Resolved
from .messages import BINARY, parse, read_file, read_prototxt
from .network import Activation, Affine, Array, Builder, Convolution, reshape
from .ssd import MAX_SIZE, SsdDetector, SsdParts

MAX_STEP = 64  # of pads, strides and dilations
# How MobileNet-SSD was trained: (BGR in 0 to 255 - 127.5) * 0.007843. A description for testing does not say it.
_SCALE = 0.007843


def load(found: Resolved, size: int | None) -> SsdDetector:
    """A caffe SSD, e.g. MobileNet-SSD for the classes of VOC: weights, and the description for testing (deploy).

    Scores are the network's softmax. The stretch to the network's square, whose size is the description's, samples as
    OpenCV's resize does. Class names are those of labels from 1 on; 0 is the background.
    """
    weights, prototxt = found.files
    return SsdDetector(found.name, read_caffe_ssd(prototxt, weights), found.names, (prototxt, weights))


@dataclass(frozen=True)
class Anchors:
    """(N, 4) center x, y, width, height, relative to the image, and (4,) factors on what is encoded of each."""

    boxes: Array
    variances: Array


Value = fx.Node | Anchors


def read_caffe_ssd(prototxt: Path, weights: Path) -> SsdParts:
    """The parts of the SSD in a caffe network.

    Raises:
        RaucaError: anything wrong with the files, weights of another network.
    """
    network = read_prototxt(prototxt)
    layers = [layer for layer in network.layer if all(rule.phase == 1 for rule in layer.include)]  # TEST
    # of caffe's two ways to declare an input, the one outside of any layer is the older
    inputs = [(network.input, network.input_shape.dim or network.input_dim)] if network.input else []
    inputs += [(_one_top(prototxt, x), x.input_param.shape.dim) for x in layers if x.type == "Input"]
    shape = list(inputs[0][1]) if len(inputs) == 1 else []
    if len(shape) != 4 or shape[1] != 3 or shape[2] != shape[3] or not 1 <= shape[2] <= MAX_SIZE:
        raise RaucaError(
            f"{prototxt}: takes {len(inputs)} inputs, of shape {shape}; expected one, (batch, 3, size, size) "
            f"up to {MAX_SIZE}"
        )
    reader = _Reader(prototxt, weights, shape[2], inputs[0][0])
    for layer in layers:
        if layer.type != "Input":
            reader.add(layer)
    if reader.output is None:
        raise RaucaError(f"{prototxt}: has no DetectionOutput layer; this is no SSD for testing")
    boxes, scores, anchors, columns = reader.output
    return SsdParts(
        path=prototxt,
        network=reader.builder.finish(boxes, scores),
        anchors=anchors.boxes,
        variances=anchors.variances,
        columns=columns,
        size=shape[2],
        rows_first=False,
        half_pixel_centers=True,
    )


def _one_top(path: Path, layer: Any) -> str:
    if len(layer.top) != 1:
        raise RaucaError(f"{path}: layer {layer.name} ({layer.type}) makes {len(layer.top)} values, expected one")
    return str(layer.top[0])


class _Reader:
    """Takes a network's layers in their order; messages of layers are those of :mod:`messages`.

    Attributes:
        output: boxes, scores, anchors and score columns, known after the ``DetectionOutput`` layer.
    """

    def __init__(self, path: Path, weights: Path, size: int, input_name: str) -> None:
        self.path, self.weights, self.size = path, weights, size
        self.blobs = read_blobs(weights)
        self.builder = Builder(path, size)
        mirrored = self.builder.add(torch.flip, self.builder.image, (1,))  # RGB to BGR
        self.input = self.builder.add(Affine(255.0 * _SCALE, -127.5 * _SCALE), mirrored)
        self.values: dict[str, Value] = {input_name: self.input}
        self.output: tuple[fx.Node, fx.Node, Anchors, int] | None = None

    def fail(self, layer: Any, what: str) -> NoReturn:
        raise RaucaError(f"{self.path}: layer {layer.name} ({layer.type}) {what}")

    def add(self, layer: Any) -> None:
        if layer.type not in _LAYERS:
            self.fail(layer, f"is not supported; known layers are {', '.join(sorted(_LAYERS))}")
        parameter, function = _LAYERS[layer.type]
        foreign = [
            field.name for field, _ in layer.ListFields() if field.name.endswith("_param") and field.name != parameter
        ]
        if foreign:
            self.fail(layer, f"has an option {foreign[0]} that is not supported; known is {parameter}")
        for name in layer.bottom:
            if name not in self.values:
                self.fail(layer, f"reads {name}, which no layer before it makes")
        inputs = [self.values[name] for name in layer.bottom]
        try:
            made = function(self, layer, getattr(layer, parameter), inputs)
        except ValueError as error:
            self.fail(layer, f"does not fit its inputs ({error})")
        if made is not None:
            self.values[_one_top(self.path, layer)] = made

    def only(self, layer: Any, inputs: Sequence[Value]) -> fx.Node:
        """The only input, a value of the image."""
        if len(inputs) != 1 or not isinstance(inputs[0], fx.Node):
            self.fail(layer, "needs one value of the image as its input")
        return inputs[0]

    def channels(self, layer: Any, inputs: Sequence[Value]) -> int:
        """Of the only input, an image."""
        shape = self.only(layer, inputs).meta["value"].shape
        if len(shape) != 4:
            self.fail(layer, "needs one image as its input")
        return int(shape[1])

    def numbers(self, layer: Any, values: Sequence[float]) -> list[float]:
        """Options that are finite, and no larger than any in use."""
        if not all(abs(value) < 1e6 for value in values):
            self.fail(layer, "has an option that is not finite, or far too large")
        return list(values)

    def take(self, layer: Any, shapes: Sequence[tuple[int, ...]]) -> list[Array]:
        """The weights of a layer as float64, if they are what its description wants."""
        blobs = self.blobs.get(layer.name, [])
        if [_trim(blob.shape) for blob in blobs] != [_trim(shape) for shape in shapes]:
            holds = ", ".join(str(blob.shape) for blob in blobs) or "nothing"
            raise RaucaError(
                f"{self.weights}: holds {holds} for the layer {layer.name} ({layer.type}) of {self.path.name}, "
                f"which takes {', '.join(map(str, shapes))}; these are the weights of another network"
            )
        return [blob.astype(np.float64).reshape(shape) for blob, shape in zip(blobs, shapes, strict=True)]


def _trim(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Old files write (1, 1, 1, C) for (C,)."""
    start = next((axis for axis, extent in enumerate(shape) if extent != 1), len(shape))
    return shape[start:]


def _convolution(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> Value:
    channels, out, groups = net.channels(layer, inputs), options.num_output, options.group
    kernel, pad, stride, dilation = (getattr(options, x) for x in ("kernel_size", "pad", "stride", "dilation"))
    if not groups or channels % groups or out % groups:
        net.fail(layer, f"has {groups} groups for {channels} channels in and {out} out")
    if max(kernel, pad, stride, dilation) > MAX_STEP or not min(kernel, stride, dilation):
        net.fail(layer, f"has a kernel_size, pad, stride or dilation beyond 1 to {MAX_STEP}")
    shapes: list[tuple[int, ...]] = [(out, channels // groups, kernel, kernel)]
    weight, *bias = net.take(layer, shapes + [(out,)] * options.bias_term)
    made = Convolution(
        weight, bias[0] if bias else np.zeros(out), (stride, stride), (dilation, dilation), (pad, pad), groups
    )
    return net.builder.add(made, *inputs)


def _batch_norm(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> Value:
    channels = net.channels(layer, inputs)
    if not options.use_global_stats:
        net.fail(layer, "normalizes by its own batch; only stored statistics are supported")
    mean, variance, count = net.take(layer, [(channels,), (channels,), (1,)])
    factor = 0.0 if count[0] == 0 else 1 / count[0]  # caffe keeps sums and how much went into them
    scale = 1 / np.sqrt(np.maximum(variance * factor, 0.0) + net.numbers(layer, [options.eps])[0])
    return net.builder.add(Affine(scale, -mean * factor * scale), *inputs)


def _scale(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> Value:
    channels = net.channels(layer, inputs)
    scale, *shift = net.take(layer, [(channels,)] * (2 if options.bias_term else 1))
    return net.builder.add(Affine(scale, shift[0] if shift else np.zeros(channels)), *inputs)


def _relu(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> Value:
    if options.negative_slope:
        net.fail(layer, "leaks; only a negative_slope of 0 is supported")
    return net.builder.add(Activation("Relu"), net.only(layer, inputs))


def _permute(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> Value:
    if list(options.order) != [0, 2, 3, 1]:
        net.fail(layer, f"permutes to {list(options.order)}; only 0, 2, 3, 1 is supported")
    return net.builder.add(torch.permute, net.only(layer, inputs), (0, 2, 3, 1))


def _flatten(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> Value:
    if options.axis != 1:
        net.fail(layer, "flattens from another axis than 1")
    return net.builder.add(reshape, net.only(layer, inputs), (0, -1))


def _reshape(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> Value:
    shape = tuple(options.shape.dim)
    if not 1 <= len(shape) <= 4 or min(shape) < -1 or max(shape) > 2**31 or shape.count(-1) > 1:
        net.fail(layer, f"reshapes to {shape}")
    return net.builder.add(reshape, net.only(layer, inputs), shape)


def _softmax(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> Value:
    if not 1 <= options.axis <= 3:
        net.fail(layer, f"is over axis {options.axis}, expected 1 to 3")
    return net.builder.add(torch.softmax, net.only(layer, inputs), options.axis)


def _concat(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> Value:
    anchors = [value for value in inputs if isinstance(value, Anchors)]
    if anchors and len(anchors) == len(inputs) and options.axis == 2:
        if len({tuple(value.variances) for value in anchors}) != 1:
            net.fail(layer, "joins anchors of different variances")
        return Anchors(np.concatenate([value.boxes for value in anchors]), anchors[0].variances)
    if anchors or not inputs or options.axis != 1:
        net.fail(layer, "joins something else than flat heads along axis 1, or anchors along axis 2")
    return net.builder.add(torch.cat, inputs, 1)


def _prior_box(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> Value:
    """Anchors of one feature map, cell by cell in rows."""
    if len(inputs) != 2 or inputs[1] is not net.input:
        net.fail(layer, "needs a feature map and the network's input")
    net.channels(layer, inputs[:1])
    rows, columns = inputs[0].meta["value"].shape[2:]  # type: ignore[union-attr]  # an image, or the line before fails
    sizes = _anchor_sizes(net, layer, options)
    given = ["step"] * 2 if options.HasField("step") else [x for x in ("step_h", "step_w") if options.HasField(x)]
    step = net.numbers(layer, [getattr(options, name) for name in given])
    if len(step) not in (0, 2) or min(step, default=1) <= 0:
        net.fail(layer, "needs one positive step, or both step_h and step_w, or none of them")
    step_rows, step_columns = step or (net.size / rows, net.size / columns)
    (offset,) = net.numbers(layer, [options.offset])
    y, x = np.meshgrid(
        (np.arange(rows) + offset) * step_rows, (np.arange(columns) + offset) * step_columns, indexing="ij"
    )
    centers = np.repeat(np.stack([x, y], -1).reshape(-1, 1, 2), len(sizes), axis=1)
    boxes = np.concatenate([centers, np.broadcast_to(sizes, centers.shape)], -1).reshape(-1, 4) / net.size
    if options.clip:
        low, high = ((boxes[:, :2] + sign * boxes[:, 2:] / 2).clip(0, 1) for sign in (-1, 1))
        boxes = np.concatenate([(low + high) / 2, high - low], axis=1)
    variances = net.numbers(layer, options.variance) or [0.1]
    if len(variances) not in (1, 4) or min(variances) <= 0:
        net.fail(layer, f"has variances {variances}, expected one or four positive numbers")
    return Anchors(boxes, np.broadcast_to(np.array(variances), 4))


def _anchor_sizes(net: _Reader, layer: Any, options: Any) -> Array:
    """(K, 2) widths and heights of the anchors of one cell, pixels, in caffe's order."""
    smallest, largest, given = (
        net.numbers(layer, x) for x in (options.min_size, options.max_size, options.aspect_ratio)
    )
    if not smallest or min([*smallest, *given, *largest]) <= 0 or len(largest) not in (0, len(smallest)):
        net.fail(layer, "needs positive sizes and aspect ratios, and as many max_size as min_size or none")
    ratios: list[float] = []
    for ratio in given:
        for wanted in (ratio, 1 / ratio if options.flip else ratio):
            if not any(math.isclose(wanted, known, abs_tol=1e-6) for known in [1.0, *ratios]):
                ratios.append(wanted)
    sizes = []
    for number, low in enumerate(smallest):
        sizes.append((low, low))
        if largest:
            sizes.append((math.sqrt(low * largest[number]),) * 2)
        sizes += [(low * math.sqrt(ratio), low / math.sqrt(ratio)) for ratio in ratios]
    return np.array(sizes)


def _detection_output(net: _Reader, layer: Any, options: Any, inputs: list[Value]) -> None:
    """Its suppression is replaced by this package's; the rest must be what the decoder does."""
    code_type = layer.detection_output_param.DESCRIPTOR.fields_by_name["code_type"].enum_type
    expected = {
        "code_type": code_type.values_by_name["CENTER_SIZE"].number,
        "share_location": True,
        "background_label_id": 0,
        "variance_encoded_in_target": False,
    }
    for option, wanted in expected.items():
        if getattr(options, option) != wanted:
            net.fail(layer, f"has another {option} than the only one that is supported")
    if [type(value) for value in inputs] != [fx.Node, fx.Node, Anchors] or net.output:
        net.fail(layer, "needs boxes, scores and anchors, and must be the only one")
    boxes, scores, anchors = inputs
    assert isinstance(boxes, fx.Node)
    assert isinstance(scores, fx.Node)
    assert isinstance(anchors, Anchors)
    net.output = boxes, scores, anchors, options.num_classes


# By type: the field with its options, and what makes a value of it
_LAYERS: dict[str, tuple[str, Callable[[_Reader, Any, Any, list[Value]], Value | None]]] = {
    "Convolution": ("convolution_param", _convolution),
    "BatchNorm": ("batch_norm_param", _batch_norm),
    "Scale": ("scale_param", _scale),
    "ReLU": ("relu_param", _relu),
    "Permute": ("permute_param", _permute),
    "Flatten": ("flatten_param", _flatten),
    "Reshape": ("reshape_param", _reshape),
    "Softmax": ("softmax_param", _softmax),
    "Concat": ("concat_param", _concat),
    "PriorBox": ("prior_box_param", _prior_box),
    "DetectionOutput": ("detection_output_param", _detection_output),
}

MAX_LAYERS = 10_000


def read_blobs(path: Path) -> dict[str, list[NDArray[Any]]]:
    """Weights in the order in which each layer holds them.

    Raises:
        RaucaError: missing, cut off or damaged file, a file of caffe's old format, values that do not fill a shape.
    """
    net = read_file(BINARY.NetParameter, path)
    if net.layers:
        raise RaucaError(f"{path}: is in caffe's format of before 2014; upgrade it with upgrade_net_proto_binary")
    if len(net.layer) > MAX_LAYERS:
        raise RaucaError(f"{path}: holds {len(net.layer)} layers; at most {MAX_LAYERS} are read")
    found: dict[str, list[NDArray[Any]]] = {}
    for data in net.layer:
        layer = parse(BINARY.LayerParameter, data, path)
        blobs = [_read_blob(path, layer.name, blob) for blob in layer.blobs]
        if layer.name in found and blobs:
            raise RaucaError(f"{path}: two layers are called {layer.name}")
        found.setdefault(layer.name, blobs)
    if not any(found.values()):
        raise RaucaError(f"{path}: holds no weights; this is no caffemodel")
    return found


def _read_blob(path: Path, layer: str, data: bytes) -> NDArray[Any]:
    blob = parse(BINARY.BlobProto, data, path)
    values = np.array(blob.data, np.float32) if blob.data else np.array(blob.double_data, np.float64)
    # before blobs had shapes they were always num, channels, height, width
    given = parse(BINARY.BlobShape, blob.shape, path).dim if blob.shape else ()
    shape = list(given) or [blob.num, blob.channels, blob.height, blob.width]
    if not all(0 < extent < 2**31 for extent in shape) or math.prod(shape) != len(values):
        raise RaucaError(f"{path}: layer {layer} holds {len(values)} values for a shape of {shape[:8]}; damaged file")
    if not np.isfinite(values).all():
        raise RaucaError(f"{path}: layer {layer} holds values that are not finite; damaged file")
    return values.reshape(shape)
