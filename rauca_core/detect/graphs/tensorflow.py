"""SSD graphs that TensorFlow's object detection API froze, without TensorFlow."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from torch import fx

from ...contract import RaucaError
from ..families import Resolved
from .network import Affine, Array, Builder
from .ssd import MAX_SIZE, SsdDetector, SsdParts
from .tensorflow_file import Node, read_graph
from .tensorflow_layers import Value, to_layers

# Names that the object detection API gives, in the graph for servers and in the one for TensorFlow Lite.
_SCORES = "Postprocessor/convert_scores"
_ENCODINGS = "Postprocessor/Decode/transpose"
_ANCHORS = "Postprocessor/Decode/get_center_coordinates_and_sizes/transpose"
_DIVISORS = tuple(
    f"Postprocessor/Decode/{name}/y" for name in ("div_1", "div", "div_3", "div_2")
)  # x, y, width, height
_IMAGE = "Preprocessor/map/TensorArrayStack/TensorArrayGatherV3"
_LITE = "TFLite_Detection_PostProcess"
_LITE_IMAGE = "normalized_input_image_tensor"
_RESHAPING = frozenset({"Transpose", "Reshape", "Tile", "ExpandDims", "Identity"})


def load(found: Resolved, size: int | None) -> SsdDetector:
    """An SSD of TensorFlow's object detection API, e.g. SSD-MobileNetV2 or V3: a frozen_inference_graph.pb.

    The graph's loops that resize, decode and suppress are replaced by this package's; weights, anchors, scales, the
    kind of score and the resize's sampling are read from it. Differs from TensorFlow in that 8-bit images are not
    rounded after the stretch (neither does the graph) and that suppression follows this interface's thresholds.

    Class names are those of label ids from 1 on, those that COCO never gave out among them; or COCO's 80.
    """
    parts = read_tensorflow_ssd(found.files[0])
    if size is not None and size != parts.size:
        raise RaucaError(f"{found.name}: input size must be {parts.size}, for which the graph's anchors are made")
    return SsdDetector(found.name, parts, found.names, found.files[:1])


def read_tensorflow_ssd(path: Path) -> SsdParts:
    """The parts of the SSD in a frozen graph; raises :class:`RaucaError` for anything wrong with the file."""
    nodes = read_graph(path)
    lite = next((node for node in nodes.values() if node.op == _LITE), None)
    return _of_server(path, nodes) if lite is None else _of_lite(path, nodes, lite)


def _of_lite(path: Path, nodes: dict[str, Node], post: Node) -> SsdParts:
    """The graph exported for TensorFlow Lite takes the normalized image and names everything in its last node."""
    if len(post.inputs) != 3:
        post.fail(f"has {len(post.inputs)} inputs, expected boxes, scores and anchors")
    image = _node(path, nodes, _LITE_IMAGE)
    shape = image.shape(image.get("shape", "shape", b""))
    if len(shape) != 4 or shape[1] != shape[2] or not 1 <= shape[1] <= MAX_SIZE or shape[3] != 3:
        image.fail(f"takes images of shape {shape}, expected (batch, size, size, 3)")
    builder = Builder(path, shape[1])
    # the API's MobileNets are trained on [-1, 1]; this graph leaves that, and the resize, to the caller
    given = builder.add(Affine(2.0, -1.0), builder.image)
    encodings, scores, anchors = to_layers(nodes, builder, _LITE_IMAGE, given, post.inputs)
    return SsdParts(
        path=path,
        network=builder.finish(_rows(post, encodings), _rows(post, scores)),
        anchors=_anchors(post, anchors)[:, [1, 0, 3, 2]],  # already y, x, height, width
        variances=_variances(post, np.array([post.number(f"{axis}_scale") for axis in "xywh"])),
        columns=post.get("num_classes", "i") + 1,
        size=shape[1],
        rows_first=True,
        half_pixel_centers=True,
    )


def _of_server(path: Path, nodes: dict[str, Node]) -> SsdParts:
    """The graph for servers resizes 8-bit images in a loop; what the loop gathers is the image, 0 to 255."""
    found = [node for node in nodes.values() if node.op == "ResizeBilinear" and node.name.startswith("Preprocessor/")]
    if len(found) != 1:
        raise RaucaError(
            f"{path}: {len(found)} nodes ResizeBilinear under Preprocessor/, expected one; "
            "no SSD graph of the TensorFlow object detection API"
        )
    resize = found[0]
    size = _node(path, nodes, resize.inputs[1] if len(resize.inputs) == 2 else "").tensor().reshape(-1).tolist()
    if resize.get("align_corners", "b", False) or len(set(size)) != 1 or not 1 <= size[0] <= MAX_SIZE:
        resize.fail(f"resizes to {size}, or aligns corners; only squares up to {MAX_SIZE} without that are supported")
    builder = Builder(path, int(size[0]))
    given = builder.add(Affine(255.0, 0.0), builder.image)
    wanted = (_source(path, nodes, _ENCODINGS), _SCORES, _source(path, nodes, _ANCHORS))
    encodings, scores, corners = to_layers(nodes, builder, _IMAGE, given, wanted)
    scales = np.concatenate([_node(path, nodes, name).tensor().reshape(-1) for name in _DIVISORS], dtype=np.float64)
    post = nodes[_SCORES]
    low, high = np.split(_anchors(post, corners)[:, [1, 0, 3, 2]], 2, axis=1)
    return SsdParts(
        path=path,
        network=builder.finish(_rows(post, encodings), _rows(post, scores)),
        anchors=np.concatenate([(low + high) / 2, high - low], axis=1),
        variances=_variances(post, scales),
        columns=None,
        size=builder.size,
        rows_first=True,
        half_pixel_centers=resize.get("half_pixel_centers", "b", False),
    )


def _node(path: Path, nodes: dict[str, Node], name: str) -> Node:
    if name not in nodes:
        raise RaucaError(f"{path}: node {name} is missing; no SSD graph of the TensorFlow object detection API")
    return nodes[name]


def _source(path: Path, nodes: dict[str, Node], name: str) -> str:
    """The node whose value ``name`` only gives another shape."""
    node = _node(path, nodes, name)
    for _ in range(len(nodes)):
        if node.op not in _RESHAPING or not node.inputs:
            return node.name
        node = _node(path, nodes, node.inputs[0])
    node.fail("is part of a cycle")


def _anchors(node: Node, value: Value) -> Array:
    if isinstance(value, fx.Node) or value.ndim != 2 or value.shape[1] != 4 or not np.isfinite(value).all():
        node.fail("has no anchors: expected a constant (N, 4) of finite numbers")
    return value.astype(np.float64)


def _variances(node: Node, scales: Array) -> Array:
    if scales.shape != (4,) or not (np.isfinite(scales).all() and (scales > 0).all()):
        node.fail(f"scales boxes by {scales.tolist()}; expected four positive numbers")
    return 1 / scales


def _rows(node: Node, value: Value) -> fx.Node:
    if not isinstance(value, fx.Node) or value.meta["value"].ndim != 3:
        node.fail("does not read the rows of heads")
    return value
