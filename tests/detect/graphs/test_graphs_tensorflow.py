"""Synthetic TensorFlow graphs against a naive interpreter of TensorFlow's operators, and against hostile changes."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rauca_core.contract import RaucaError
from rauca_core.detect import load_detector
from rauca_core.detect.graphs.network import Affine, Convolution
from rauca_core.detect.graphs.tensorflow import read_tensorflow_ssd
from tests.detect.gradients import checked_gradient

NAMES = ("person", "bicycle", "car", "kite")


class Naive:
    """Evaluates nodes one by one in NHWC and float64, convolutions window by window."""

    def __init__(self, nodes: dict[str, tuple[str, list[str], dict[str, Any]]], **feeds: NDArray[Any]) -> None:
        self.nodes, self.values = nodes, dict(feeds)

    def __call__(self, name: str) -> NDArray[Any]:
        if name not in self.values:
            op, inputs, attributes = self.nodes[name]
            if op == "Const":
                self.values[name] = np.asarray(attributes["value"])
            else:
                self.values[name] = getattr(self, op.lower())(attributes, *[self(source) for source in inputs])
        return self.values[name]

    @staticmethod
    def _windows(x: NDArray[Any], kernel: tuple[int, int], attributes: dict[str, Any]) -> Any:
        (_, sy, sx, _), (_, dy, dx, _) = attributes["strides"], attributes["dilations"]
        reach = (kernel[0] - 1) * dy + 1, (kernel[1] - 1) * dx + 1
        if attributes["padding"] == "SAME":
            rows, columns = -(-x.shape[1] // sy), -(-x.shape[2] // sx)
            total = [
                max((n - 1) * s + r - e, 0)
                for n, s, r, e in zip((rows, columns), (sy, sx), reach, x.shape[1:3], strict=True)
            ]
            x = np.pad(x, [(0, 0), *((t // 2, t - t // 2) for t in total), (0, 0)])
        else:
            rows, columns = (x.shape[1] - reach[0]) // sy + 1, (x.shape[2] - reach[1]) // sx + 1
        for row, column in itertools.product(range(rows), range(columns)):
            top, left = row * sy, column * sx
            yield row, column, (rows, columns), x[:, top : top + reach[0] : dy, left : left + reach[1] : dx]

    def conv2d(self, a: dict[str, Any], x: NDArray[Any], w: NDArray[Any]) -> NDArray[Any]:
        out = {(r, c): np.tensordot(v, w, ((1, 2, 3), (0, 1, 2))) for r, c, _, v in self._windows(x, w.shape[:2], a)}
        return self._grid(out)

    def depthwiseconv2dnative(self, a: dict[str, Any], x: NDArray[Any], w: NDArray[Any]) -> NDArray[Any]:
        out = {
            (r, c): np.einsum("bhwc,hwcm->bcm", v, w).reshape(len(x), -1)
            for r, c, _, v in self._windows(x, w.shape[:2], a)
        }
        return self._grid(out)

    @staticmethod
    def _grid(cells: dict[tuple[int, int], NDArray[Any]]) -> NDArray[Any]:
        rows, columns = (max(axis) + 1 for axis in zip(*cells, strict=True))
        return np.stack([np.stack([cells[r, c] for c in range(columns)], 1) for r in range(rows)], 1)

    def fusedbatchnormv3(
        self, a: dict[str, Any], x: Any, gamma: Any, beta: Any, mean: Any, variance: Any
    ) -> NDArray[Any]:
        return gamma * (x - mean) / np.sqrt(variance + a["epsilon"]) + beta

    def mean(self, a: dict[str, Any], x: Any, axes: Any) -> NDArray[Any]:
        return x.mean(tuple(axes), keepdims=a["keep_dims"])

    def stridedslice(self, a: dict[str, Any], x: Any, begin: Any, *_: Any) -> NDArray[Any]:
        return x[begin[0]]

    def concatv2(self, a: dict[str, Any], *x: Any) -> NDArray[Any]:
        return np.concatenate(x[:-1], int(x[-1]))

    def softmax(self, a: dict[str, Any], x: Any) -> NDArray[Any]:
        e = np.exp(x - x.max(-1, keepdims=True))
        return e / e.sum(-1, keepdims=True)

    add = addv2 = biasadd = staticmethod(lambda a, x, y: x + y)
    sub = staticmethod(lambda a, x, y: x - y)
    mul = staticmethod(lambda a, x, y: x * y)
    realdiv = staticmethod(lambda a, x, y: x / y)
    rsqrt = staticmethod(lambda a, x: x**-0.5)
    relu = staticmethod(lambda a, x: np.maximum(x, 0))
    relu6 = staticmethod(lambda a, x: np.clip(x, 0, 6))
    sigmoid = staticmethod(lambda a, x: 1 / (1 + np.exp(-x)))
    identity = staticmethod(lambda a, x: x)
    shape = staticmethod(lambda a, x: np.array(x.shape))
    pack = staticmethod(lambda a, *x: np.stack(x))
    reshape = staticmethod(lambda a, x, shape: x.reshape(shape))
    squeeze = staticmethod(lambda a, x: x.squeeze(tuple(a["squeeze_dims"])))


def is_lite(graph: Any) -> bool:
    return "post" in graph.nodes


def naive(graph: Any, images: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Boxes (B, N, 4) xyxy in pixels, scores (B, N, classes + 1), as TensorFlow's documentation defines them.

    One image at a time: the graph for TensorFlow Lite has a batch of one written into it.
    """
    nhwc = images.transpose(0, 2, 3, 1).astype(np.float64)
    if is_lite(graph):
        run = Naive(graph.nodes, normalized_input_image_tensor=nhwc * 2 - 1)
        scores, anchors = run("convert_scores"), run("anchors")
        scale = {axis: graph.nodes["post"][2][f"{axis}_scale"] for axis in "yxhw"}
    else:
        run = Naive(graph.nodes, **{"Preprocessor/map/TensorArrayStack/TensorArrayGatherV3": nhwc * 255})
        scores, corners = run("Postprocessor/convert_scores"), run("Concatenate/concat")
        anchors = np.concatenate([(corners[:, :2] + corners[:, 2:]) / 2, corners[:, 2:] - corners[:, :2]], 1)
        divisors = dict(zip("yxhw", ("div", "div_1", "div_2", "div_3"), strict=True))
        scale = {axis: float(run(f"Postprocessor/Decode/{name}/y")) for axis, name in divisors.items()}
    code = run("Squeeze")
    (ya, xa, ha, wa), (ty, tx, th, tw) = anchors.T, np.moveaxis(code, -1, 0)
    y, x = ty / scale["y"] * ha + ya, tx / scale["x"] * wa + xa
    h, w = np.exp(th / scale["h"]) * ha, np.exp(tw / scale["w"]) * wa
    boxes = np.stack([x - w / 2, y - h / 2, x + w / 2, y + h / 2], -1)
    return boxes, scores, code


def test_every_operator_agrees_with_the_naive_interpreter(graph: Any, tmp_path: Path, rng: np.random.Generator) -> None:
    detector = load_detector(graph.save(tmp_path / "small.pb"), names=NAMES)
    images = rng.random((2, 3, 33, 33)).astype(np.float32)
    boxes, scores, code = (np.concatenate(part) for part in zip(*(naive(graph, x[None]) for x in images), strict=True))
    found = detector.dense(torch.from_numpy(images))
    assert np.abs(code).max() > 1
    assert np.ptp(scores) > 0.3
    np.testing.assert_allclose(found.boxes, boxes * 33, atol=1e-3)
    np.testing.assert_allclose(found.classes, scores[..., 1:], atol=1e-5)
    assert (found.objectness == 1).all()


def test_norms_and_hard_swish_disappear(graph: Any, tmp_path: Path) -> None:
    detector = load_detector(graph.save(tmp_path / "small.pb"), names=NAMES)
    steps = list(detector.network.layers.modules())
    assert sum(isinstance(step, Convolution) for step in steps) == 12
    # the image's normalization, and squeeze-excite's sixth behind a relu6
    assert sum(isinstance(step, Affine) for step in steps) == 2
    assert [getattr(step, "kind", "") for step in steps].count("HardSwish") == 1


@pytest.mark.parametrize(
    ("size", "kernel", "stride", "dilation"), [*itertools.product((5, 8, 11), (1, 2, 3, 5), (1, 2, 3), (1, 2))]
)
def test_same_padding_is_tensorflows(
    size: int, kernel: int, stride: int, dilation: int, rng: np.random.Generator
) -> None:
    w, x = rng.normal(size=(kernel, kernel, 2, 3)), rng.normal(size=(1, size, size + 1, 2))
    layer = Convolution(w.transpose(3, 2, 0, 1), np.zeros(3), (stride,) * 2, (dilation,) * 2, None, 1)
    ours = layer(torch.from_numpy(x).permute(0, 3, 1, 2))
    attributes = {"strides": [1, stride, stride, 1], "dilations": [1, dilation, dilation, 1], "padding": "SAME"}
    theirs = Naive({}).conv2d(attributes, x, w)
    np.testing.assert_allclose(ours.permute(0, 2, 3, 1), theirs, atol=1e-5)


def test_gradient_matches_finite_differences(graph: Any, tmp_path: Path) -> None:
    detector = load_detector(graph.save(tmp_path / "small.pb"), names=NAMES)
    gradient = checked_gradient(detector, torch.rand(2, 3, 40, 52))
    assert (gradient.abs().sum(1) > 0).double().mean() > 0.9
    assert not any(parameter.requires_grad for parameter in detector.network.parameters())


def test_predicting_leaves_no_trace(graph: Any, tmp_path: Path) -> None:
    """Activations overwrite their input: with and without a gradient the same must come out, twice."""
    detector = load_detector(graph.save(tmp_path / "small.pb"), names=NAMES)
    images = torch.rand(1, 3, 33, 33, requires_grad=True)
    before = images.detach().clone()
    first = detector.dense(images)
    first.classes.sum().backward()
    with torch.inference_mode():
        second = detector.dense(images.detach())
    assert torch.equal(images.detach(), before)
    torch.testing.assert_close(first.classes.detach(), second.classes)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_flat_images_and_wild_boxes_keep_finite_gradients(graph: Any, tmp_path: Path, value: float) -> None:
    for name in ("BoxPredictor_0/Box/bias", "BoxPredictor_1/Box/bias"):
        bias = graph.nodes[name][2]["value"]
        graph.const(name, np.full(bias.shape, 2000.0))  # exp(2000 / 5) is not finite in float32
    detector = load_detector(graph.save(tmp_path / "small.pb"), names=NAMES)
    images = torch.full((1, 3, 20, 33), value, requires_grad=True)
    found = detector.dense(images)
    (found.boxes.sum() + found.classes.sum()).backward()
    assert images.grad is not None
    assert all(torch.isfinite(t).all() for t in (found.boxes, found.classes, images.grad))


def change(node: str, **attributes: Any) -> Any:
    def apply(g: Any) -> None:
        op, inputs, old = g.nodes[node]
        g.nodes[node] = (op, inputs, {**old, **attributes})

    return apply


def rename_op(node: str, op: str) -> Any:
    return lambda g: g.nodes.update({node: (op, *g.nodes[node][1:])})


def rewire(node: str, *inputs: str) -> Any:
    return lambda g: g.nodes.update({node: (g.nodes[node][0], list(inputs), g.nodes[node][2])})


def fill(node: str, shape: tuple[int, ...], value: float = 0.1) -> Any:
    return lambda g: g.const(node, np.full(shape, value))


FAULTS = [
    (rename_op("expand/Relu", "Elu"), r"node expand/Relu \(Elu\) is not supported; known operators are Add, .*Relu6"),
    (lambda g: g.nodes.pop("swish/weights/read"), r"node swish/weights/read is missing"),
    (rewire("stem/Relu6", "residual"), r"is part of a cycle"),
    (rewire("residual", "residual", "residual"), r"node residual \(AddV2\) is part of a cycle"),
    (
        fill("stem/weights", (3, 3, 4, 8)),
        r"stem/Conv2D \(Conv2D\) has a kernel of shape \(3, 3, 4, 8\) for an image of 3",
    ),
    (fill("swish/bn/gamma", (7,)), r"has statistics of shape \(7,\) for 8 channels"),
    (fill("stem/weights", (3, 3, 3, 8), np.nan), r"reads values that are not finite \(input 1\)"),
    (change("stem/Conv2D", strides=[1, 2, 2, 2]), r"has strides \[1, 2, 2, 2\]"),
    (change("stem/Conv2D", dilations=[1, 10**9, 10**9, 1]), r"has dilations \[1, 1000000000, 1000000000, 1\]"),
    (change("stem/Conv2D", padding="EXPLICIT"), r"pads 'EXPLICIT'; known are SAME and VALID"),
    (change("stem/Conv2D", data_format="NCHW"), r"is not laid out as NHWC"),
    (change("swish/bn", is_training=True), r"is in training mode"),
    (change("se/Mean", keep_dims=False), r"averages over axes \[1, 2\]"),
    (rewire("se/mul", "se/gate", "stem/Relu6"), r"node se/mul \(Mul\) does not fit its inputs"),
    (rewire("residual", "expand/Relu", "project/bn"), r"\(AddV2\) does not fit its inputs"),
    (rewire("BoxPredictor_1/Box/Reshape", "BoxPredictor_0/Box/Reshape", "axis"), r"needs an image as input 0"),
    (rewire("concat"), r"concat \(ConcatV2\) has 0 inputs"),
    (rewire("BoxPredictor_1/Box/Reshape", "BoxPredictor_1/Box/BiasAdd", "se/biases"), r"reshapes 12 channels to \["),
    (rename_op("se/sixth", "Placeholder"), r"node se/sixth \(Placeholder\) is not supported"),
]


@pytest.mark.parametrize(("fault", "complaint"), FAULTS)
def test_a_wrong_graph_is_refused(graph: Any, tmp_path: Path, fault: Any, complaint: str) -> None:
    fault(graph)
    with pytest.raises(RaucaError, match=complaint) as refusal:
        load_detector(graph.save(tmp_path / "small.pb"), names=NAMES)
    assert "\n" not in str(refusal.value)
    assert "small.pb" in str(refusal.value)


@pytest.mark.parametrize("value", [0.0, -5.0, np.nan, [10.0, 10.0]])
def test_boxes_need_four_positive_scales(server_graph: Any, tmp_path: Path, value: Any) -> None:
    server_graph.const("Postprocessor/Decode/div_2/y", value)
    with pytest.raises(RaucaError, match=r"scales boxes by \[.*\]; expected four positive numbers"):
        load_detector(server_graph.save(tmp_path / "small.pb"), names=NAMES)


def test_an_infinite_anchor_is_refused(graph: Any, tmp_path: Path) -> None:
    name = "anchors" if is_lite(graph) else "low"
    graph.nodes[name][2]["value"][3, 2] = np.inf
    with pytest.raises(RaucaError, match=r"has no anchors: expected a constant \(N, 4\) of finite numbers"):
        load_detector(graph.save(tmp_path / "small.pb"), names=NAMES)


def test_another_number_of_anchors_is_refused(graph: Any, tmp_path: Path) -> None:
    name = "anchors" if is_lite(graph) else "high"
    graph.const(name, graph.nodes[name][2]["value"][:-1])
    with pytest.raises(RaucaError, match=r"685 anchors, but heads of 686 boxes"):
        load_detector(graph.save(tmp_path / "small.pb"), names=NAMES)


@pytest.mark.parametrize(
    ("op", "inputs"), [("Fill", ("huge", "axis")), ("Tile", ("low", "huge")), ("Range", ("zero", "many", "axis"))]
)
def test_constants_that_would_fill_the_memory_are_refused(
    server_graph: Any, op: str, inputs: tuple[str, ...], tmp_path: Path
) -> None:
    graph = server_graph
    graph.const("huge", [2**20, 2**20])
    graph.const("many", 2**30)
    graph(op, "made", *inputs)
    graph("ConcatV2", "Concatenate/concat", "made", "high", "zero")
    with pytest.raises(RaucaError, match=rf"node made \({op}\) would make \d+ elements"):
        load_detector(graph.save(tmp_path / "small.pb"), names=NAMES)


def test_a_chain_of_any_length_is_read(graph: Any, tmp_path: Path) -> None:
    name = "back/Conv2D"
    for number in range(3000):
        name = graph("Identity", f"chain/{number}", name)
    rewire("residual", name, "project/bn")(graph)
    assert read_tensorflow_ssd(graph.save(tmp_path / "small.pb")).size == 33


def test_sizes_and_class_lists_are_checked(graph: Any, tmp_path: Path) -> None:
    path = graph.save(tmp_path / "small.pb")
    with pytest.raises(RaucaError, match=r"small: input size must be 33, for which the graph's anchors are made"):
        load_detector(path, 64, names=NAMES)
    with pytest.raises(RaucaError, match=r"small\.pb: the network predicts 4 classes; 3 class names were given"):
        load_detector(path, names=NAMES[:3])


def test_the_fingerprint_follows_the_file(graph: Any, tmp_path: Path) -> None:
    path = graph.save(tmp_path / "small.pb")
    first = load_detector(path, names=NAMES).fingerprint
    assert load_detector(path, 33, names=NAMES).fingerprint == first
    graph.nodes["stem/weights"][2]["value"][0, 0, 0, 0] += 1e-3
    assert load_detector(graph.save(path), names=NAMES).fingerprint != first


def test_a_graph_cut_off_anywhere_is_refused(graph: Any, tmp_path: Path) -> None:
    data = graph.save(tmp_path / "small.pb").read_bytes()
    cut = tmp_path / "cut.pb"
    for length in [*range(0, 400), *range(400, len(data), 997)]:
        cut.write_bytes(data[:length])
        with pytest.raises(RaucaError, match=r"cut\.pb"):
            load_detector(cut, names=NAMES)
