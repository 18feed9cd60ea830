"""Graphs as TensorFlow writes them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rauca_core.detect.graphs.messages import BINARY

torch.set_num_threads(1)
cv2.setNumThreads(1)


def write(kind: str, **fields: Any) -> bytes:
    """A message; those inside it are given as this writes them."""
    data: bytes = getattr(BINARY, kind)(**fields).SerializeToString()
    return data


TYPES = {"float32": 1, "float64": 2, "int32": 3, "int64": 9}


class GraphWriter:
    """Collects the nodes of a graph: kept for the naive interpreter, written by protobuf."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(7)
        self.nodes: dict[str, tuple[str, list[str], dict[str, Any]]] = {}

    def __call__(self, op: str, name: str, *inputs: str, **attributes: Any) -> str:
        self.nodes[name] = (op, list(inputs), attributes)
        return name

    def const(self, name: str, value: Any) -> str:
        array = np.asarray(value)
        return self("Const", name, value=array.astype("float32" if array.dtype.kind == "f" else "int32"))

    def save(self, path: Path) -> Path:
        nodes = []
        for name, (op, inputs, attributes) in self.nodes.items():
            entries = [write("Entry", key=key, value=attribute(value)) for key, value in attributes.items()]
            nodes.append(write("NodeDef", name=name, op=op, input=inputs, attr=entries))
        path.write_bytes(write("GraphDef", node=nodes))
        return path


def attribute(value: Any) -> bytes:
    """An attribute in the field of its type."""
    for kind, field in ((bool, "b"), (int, "i"), (float, "f"), (str, "s")):
        if isinstance(value, kind):
            return write("AttrValue", **{field: value})
    if isinstance(value, list):
        return write("AttrValue", list=write("ListValue", i=value))
    if isinstance(value, tuple):
        return write("AttrValue", shape=tensor_shape(value))
    return write("AttrValue", tensor=tensor(value))


def tensor_shape(shape: tuple[int, ...]) -> bytes:
    return write("TensorShape", dim=[write("Dim", size=extent) for extent in shape])


def tensor(value: NDArray[Any]) -> bytes:
    """Small tensors as TensorFlow's converters write them, in the typed fields; others as bytes."""
    if value.size == 1:
        values: dict[str, Any] = {{"f": "float_val", "i": "int_val"}[value.dtype.kind]: [value.item()]}
    else:
        values = {"tensor_content": value.tobytes()}
    return write("TensorProto", dtype=TYPES[value.dtype.name], tensor_shape=tensor_shape(value.shape), **values)


def ssd_graph(lite: bool, size: int = 33, classes: int = 4) -> GraphWriter:
    """A small SSD with every operator: written-out and fused batch norms, hard swish, squeeze-excite, a residual."""
    g = GraphWriter()
    lite_input = "normalized_input_image_tensor"
    x = g("Placeholder", lite_input, shape=(1, size, size, 3)) if lite else _server_input(g, size)
    x = conv(g, "stem", x, 3, 8, 3, 2)
    x = g("Relu6", "stem/Relu6", _written_norm(g, "stem/bn", x, 8))
    x = _fused_norm(g, "swish/bn", conv(g, "swish", x, 8, 8, 3, 1, depthwise=True), 8)
    x = _hard_swish(g, "swish", x)
    x = residual = _fused_norm(g, "project/bn", conv(g, "project", x, 8, 8, 1, 1), 8)
    x = g("Relu", "expand/Relu", _fused_norm(g, "expand/bn", conv(g, "expand", x, 8, 16, 5, 1), 16))
    x = _squeeze_excite(g, x, 16)
    x = g("AddV2", "residual", conv(g, "back", x, 16, 8, 1, 1), residual)
    deep = conv(g, "deep", x, 8, 12, 4, 3, dilation=1)
    maps = ((x, 8, 2), (deep, 12, 3))
    boxes, scores = zip(*(_heads(g, k, *one, classes, lite) for k, one in enumerate(maps)), strict=True)
    axis = g.const("axis", 1)
    encodings = g("Squeeze", "Squeeze", g("ConcatV2", "concat", *boxes, axis), squeeze_dims=[2])
    logits = g("ConcatV2", "concat_1", *scores, axis)
    cells = math.ceil(size / 2), math.ceil(math.ceil(size / 2) / 3)
    count = cells[0] ** 2 * 2 + cells[1] ** 2 * 3
    (_lite_output if lite else _server_output)(g, encodings, logits, count, classes)
    return g


def _server_input(g: GraphWriter, size: int) -> str:
    g("Placeholder", "image_tensor")
    g.const("Preprocessor/size", [size, size])
    g("ResizeBilinear", "Preprocessor/map/while/ResizeImage/ResizeBilinear", "image_tensor", "Preprocessor/size")
    # a loop, as in the graphs of the API: nobody may walk into it
    g("Enter", "Preprocessor/map/while/Enter", "Preprocessor/map/TensorArrayStack/TensorArrayGatherV3")
    image = "Preprocessor/map/TensorArrayStack/TensorArrayGatherV3"
    g("TensorArrayGatherV3", image, "Preprocessor/map/while/Enter")
    g("Mul", "Preprocessor/mul", g.const("Preprocessor/mul/x", 2 / 255), image)
    return g("Sub", "Preprocessor/sub", "Preprocessor/mul", g.const("Preprocessor/sub/y", 1.0))


def conv(
    g: GraphWriter,
    name: str,
    x: str,
    channels: int,
    out: int,
    kernel: int,
    stride: int,
    depthwise: bool = False,
    dilation: int = 1,
    padding: str = "SAME",
) -> str:
    shape = (kernel, kernel, channels, out // channels if depthwise else out)
    fan_in = kernel * kernel * (1 if depthwise else channels)
    weights = g("Identity", f"{name}/weights/read", g.const(f"{name}/weights", g.rng.normal(0, fan_in**-0.5, shape)))
    op = "DepthwiseConv2dNative" if depthwise else "Conv2D"
    strides, dilations = [1, stride, stride, 1], [1, dilation, dilation, 1]
    return g(op, f"{name}/{op}", x, weights, strides=strides, dilations=dilations, padding=padding, data_format="NHWC")


def _statistics(g: GraphWriter, name: str, channels: int) -> list[str]:
    gamma = g.const(f"{name}/gamma", g.rng.uniform(0.8, 1.2, channels))
    beta = g.const(f"{name}/beta", g.rng.normal(0, 0.1, channels))
    mean = g.const(f"{name}/mean", g.rng.normal(0, 0.1, channels))
    return [gamma, beta, mean, g.const(f"{name}/variance", g.rng.uniform(0.5, 2.0, channels))]


def _written_norm(g: GraphWriter, name: str, x: str, channels: int) -> str:
    gamma, beta, mean, variance = _statistics(g, name, channels)
    deviation = g("Rsqrt", f"{name}/rsqrt", g("Add", f"{name}/add", variance, g.const(f"{name}/eps", 1e-3)))
    scale = g("Mul", f"{name}/mul", deviation, gamma)
    shift = g("Sub", f"{name}/sub", beta, g("Mul", f"{name}/mul_2", mean, scale))
    return g("Add", f"{name}/add_1", g("Mul", f"{name}/mul_1", x, scale), shift)


def _fused_norm(g: GraphWriter, name: str, x: str, channels: int) -> str:
    return g("FusedBatchNormV3", name, x, *_statistics(g, name, channels), epsilon=1e-3, is_training=False)


def _hard_swish(g: GraphWriter, name: str, x: str) -> str:
    gate = g("Relu6", f"{name}/Relu6", g("AddV2", f"{name}/add3", x, g.const(f"{name}/three", 3.0)))
    return g("Mul", f"{name}/sixth", g("Mul", f"{name}/gated", x, gate), g.const(f"{name}/y", 1 / 6))


def _squeeze_excite(g: GraphWriter, x: str, channels: int) -> str:
    mean = g("Mean", "se/Mean", x, g.const("se/axes", [1, 2]), keep_dims=True)
    small = conv(g, "se/Conv", mean, channels, 4, 1, 1)
    small = g("Relu", "se/Relu", g("BiasAdd", "se/BiasAdd", small, g.const("se/biases", g.rng.normal(0, 0.1, 4))))
    large = conv(g, "se/Conv_1", small, 4, channels, 1, 1)
    gate = g("Relu6", "se/Relu6", g("AddV2", "se/add", large, g.const("se/three", 3.0)))
    return g("Mul", "se/mul", x, g("Mul", "se/gate", gate, g.const("se/sixth", 1 / 6)))


def _heads(
    g: GraphWriter, index: int, x: str, channels: int, anchors: int, classes: int, lite: bool
) -> tuple[str, str]:
    """Both heads of one feature map; the server's graph asks for the batch at run time."""
    name = f"BoxPredictor_{index}"
    made = []
    for head, values in (("Box", [1, 4]), ("Class", [classes + 1])):
        kernel = conv(g, f"{name}/{head}", x, channels, anchors * values[-1], 1, 1)
        bias = g.const(f"{name}/{head}/bias", g.rng.normal(0, 0.3, anchors * values[-1]))
        biased = g("BiasAdd", f"{name}/{head}/BiasAdd", kernel, bias)
        shape = f"{name}/{head}/shape"
        if lite:
            g.const(shape, [1, -1, *values])
        else:
            zero, one = g.const(f"{shape}/0", [0]), g.const(f"{shape}/1", [1])
            of = g("Shape", f"{shape}/of", x)
            batch = g("StridedSlice", f"{shape}/batch", of, zero, one, one, shrink_axis_mask=1)
            parts = [g.const(f"{shape}/part{k}", value) for k, value in enumerate([-1, *values])]
            g("Pack", shape, batch, *parts, axis=0)
        made.append(g("Reshape", f"{name}/{head}/Reshape", biased, shape))
    return made[0], made[1]


def _anchors(g: GraphWriter, count: int) -> NDArray[np.float64]:
    """(N, 4) y, x, height, width."""
    return np.concatenate([g.rng.uniform(0.1, 0.9, (count, 2)), g.rng.uniform(0.1, 0.5, (count, 2))], 1)


def _server_output(g: GraphWriter, encodings: str, logits: str, count: int, classes: int) -> None:
    scaled = g("RealDiv", "Postprocessor/scale", logits, g.const("Postprocessor/one", 1.0))
    g("Sigmoid", "Postprocessor/convert_scores", scaled)
    anchors = _anchors(g, count)
    corners = np.concatenate([anchors[:, :2] - anchors[:, 2:] / 2, anchors[:, :2] + anchors[:, 2:] / 2], 1)
    parts = g.const("low", corners[:7]), g.const("high", corners[7:]), g.const("zero", 0)
    expanded = g("ExpandDims", "Postprocessor/ExpandDims", g("ConcatV2", "Concatenate/concat", *parts), "zero")
    tiled = g("Tile", "Postprocessor/Tile", expanded, "tiles")
    g.const("tiles", [1, 1, 1])
    flat = g("Reshape", "Postprocessor/Reshape", tiled, g.const("flat", [-1, 4]))
    g("Transpose", "Postprocessor/Decode/get_center_coordinates_and_sizes/transpose", flat)
    g("Transpose", "Postprocessor/Decode/transpose", g("Reshape", "Postprocessor/Reshape_1", encodings, "flat"))
    for name, value in (("div", 10.0), ("div_1", 9.0), ("div_2", 5.0), ("div_3", 4.0)):
        g.const(f"Postprocessor/Decode/{name}/y", value)


def _lite_output(g: GraphWriter, encodings: str, logits: str, count: int, classes: int) -> None:
    g("Softmax", "convert_scores", logits)
    scales = {"x_scale": 9.0, "y_scale": 10.0, "w_scale": 4.0, "h_scale": 5.0}
    g.const("anchors", _anchors(g, count))
    g("TFLite_Detection_PostProcess", "post", encodings, "convert_scores", "anchors", num_classes=classes, **scales)


@pytest.fixture(params=[False, True], ids=["server", "lite"])
def graph(request: pytest.FixtureRequest) -> GraphWriter:
    return ssd_graph(request.param)


@pytest.fixture
def server_graph() -> GraphWriter:
    return ssd_graph(lite=False)


@pytest.fixture
def rng() -> Iterator[np.random.Generator]:
    return np.random.default_rng(11)
