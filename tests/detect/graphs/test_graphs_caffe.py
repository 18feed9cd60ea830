"""A small caffe network with every layer, against OpenCV's own reader; and files that are wrong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rauca_core.contract import RaucaError
from rauca_core.detect import load_detector
from rauca_core.detect.graphs.caffe import read_caffe_ssd
from rauca_core.detect.graphs.messages import read_prototxt
from tests.detect.gradients import checked_gradient
from tests.detect.graphs.conftest import write

NAMES = ("bicycle", "car", "boat")
SIZE = 64

EVERY_LAYER = """
name: "every" # a comment with { a brace
input: "data"
input_shape { dim: 1 dim: 3 dim: 64 dim: 64 }
layer { name: "conv1" type: "Convolution" bottom: "data" top: "conv1" param { lr_mult: 1.0 }
  convolution_param { num_output: 8 pad: 1 kernel_size: 3 stride: 2 bias_term: false weight_filler { type: "msra" } } }
layer { name: "bn1" type: "BatchNorm" bottom: "conv1" top: "conv1"
  batch_norm_param { use_global_stats: true eps: 1e-4 } }
layer { name: "scale1" type: "Scale" bottom: "conv1" top: "conv1" scale_param { bias_term: true } }
layer { name: "relu1" type: "ReLU" bottom: "conv1" top: "conv1" }
layer { name: 'dw' type: 'Convolution' bottom: 'conv1' top: 'dw'
  convolution_param { num_output: 8 pad: 2 kernel_size: 3 stride: 2 group: 8 dilation: 2 engine: CAFFE } }
layer { name: "relu2" type: "ReLU" bottom: "dw" top: "dw" }
layer { name: "pw" type: "Convolution" bottom: "dw" top: "pw" convolution_param { num_output: 12 kernel_size: 1 } }
layer { name: "small" type: "Convolution" bottom: "pw" top: "small"
  convolution_param { num_output: 6 kernel_size: 3 stride: 2 group: 2 } }
layer { name: "loc1" type: "Convolution" bottom: "pw" top: "loc1" convolution_param { num_output: 24 kernel_size: 1 } }
layer { name: "loc1p" type: "Permute" bottom: "loc1" top: "loc1p"
  permute_param { order: 0 order: 2 order: 3 order: 1 } }
layer { name: "loc1f" type: "Flatten" bottom: "loc1p" top: "loc1f" flatten_param { axis: 1 } }
layer { name: "conf1" type: "Convolution" bottom: "pw" top: "conf1"
  convolution_param { num_output: 24 kernel_size: 1 } }
layer { name: "conf1p" type: "Permute" bottom: "conf1" top: "conf1p"
  permute_param { order: 0 order: 2 order: 3 order: 1 } }
layer { name: "conf1f" type: "Flatten" bottom: "conf1p" top: "conf1f" flatten_param { axis: 1 } }
layer { name: "prior1" type: "PriorBox" bottom: "pw" bottom: "data" top: "prior1"
  prior_box_param { min_size: 12.0 max_size: 20 aspect_ratio: 2.0 aspect_ratio: 3.0 flip: true clip: true
    variance: 0.1 variance: 0.1 variance: 0.2 variance: 0.2 offset: 0.5 } }
layer { name: "loc2" type: "Convolution" bottom: "small" top: "loc2"
  convolution_param { num_output: 8 kernel_size: 1 } }
layer { name: "loc2p" type: "Permute" bottom: "loc2" top: "loc2p"
  permute_param { order: 0 order: 2 order: 3 order: 1 } }
layer { name: "loc2f" type: "Flatten" bottom: "loc2p" top: "loc2f" }
layer { name: "conf2" type: "Convolution" bottom: "small" top: "conf2"
  convolution_param { num_output: 8 kernel_size: 1 } }
layer { name: "conf2p" type: "Permute" bottom: "conf2" top: "conf2p"
  permute_param { order: 0 order: 2 order: 3 order: 1 } }
layer { name: "conf2f" type: "Flatten" bottom: "conf2p" top: "conf2f" }
layer { name: "prior2" type: "PriorBox" bottom: "small" bottom: "data" top: "prior2"
  prior_box_param { min_size: 30.0 aspect_ratio: 2.0 flip: false clip: false step: 9
    variance: 0.1 variance: 0.1 variance: 0.2 variance: 0.2 } }
layer { name: "loc" type: "Concat" bottom: "loc1f" bottom: "loc2f" top: "loc" concat_param { axis: 1 } }
layer { name: "conf" type: "Concat" bottom: "conf1f" bottom: "conf2f" top: "conf" concat_param { axis: 1 } }
layer { name: "prior" type: "Concat" bottom: "prior1" bottom: "prior2" top: "prior" concat_param { axis: 2 } }
layer { name: "confr" type: "Reshape" bottom: "conf" top: "confr" reshape_param { shape { dim: 0 dim: -1 dim: 4 } } }
layer { name: "soft" type: "Softmax" bottom: "confr" top: "soft" softmax_param { axis: 2 } }
layer { name: "flat" type: "Flatten" bottom: "soft" top: "flat" flatten_param { axis: 1 } }
layer { name: "out" type: "DetectionOutput" bottom: "loc" bottom: "flat" bottom: "prior" top: "out"
  include { phase: TEST }
  detection_output_param { num_classes: 4 share_location: true background_label_id: 0
    nms_param { nms_threshold: 0.45 top_k: 400 } code_type: CENTER_SIZE keep_top_k: 400 confidence_threshold: 0.9 } }
"""

WEIGHTS: dict[str, list[tuple[int, ...]]] = {
    "conv1": [(8, 3, 3, 3)],
    "bn1": [(8,), (8,), (1,)],
    "scale1": [(8,), (8,)],
    "dw": [(8, 1, 3, 3), (8,)],
    "pw": [(12, 8, 1, 1), (12,)],
    "small": [(6, 6, 3, 3), (6,)],
    "loc1": [(24, 12, 1, 1), (24,)],
    "conf1": [(24, 12, 1, 1), (24,)],
    "loc2": [(8, 6, 1, 1), (8,)],
    "conf2": [(8, 6, 1, 1), (8,)],
}


def random_weights() -> dict[str, list[NDArray[np.float32]]]:
    rng = np.random.default_rng(5)
    found: dict[str, list[NDArray[np.float32]]] = {}
    for layer, shapes in WEIGHTS.items():
        found[layer] = [rng.normal(0, 1.5 * np.prod(shape[1:]) ** -0.5, shape).astype(np.float32) for shape in shapes]
    found["bn1"] = [found["bn1"][0], rng.uniform(1, 2, 8).astype(np.float32), np.array([2.5], np.float32)]
    return found


def save(path: Path, weights: dict[str, list[NDArray[np.float32]]]) -> Path:
    layers = []
    for name, blobs in weights.items():
        written = [
            write("BlobProto", data=blob.reshape(-1), shape=write("BlobShape", dim=blob.shape)) for blob in blobs
        ]
        layers.append(write("LayerParameter", name=name, type="Convolution", blobs=written))
    path.write_bytes(write("NetParameter", name="every", layer=layers))
    return path


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """(prototxt, caffemodel)"""
    (tmp_path / "every.prototxt").write_text(EVERY_LAYER)
    return tmp_path / "every.prototxt", save(tmp_path / "every.caffemodel", random_weights())


def opencv(files: tuple[Path, Path], image: NDArray[np.float32]) -> tuple[cv2.dnn.Net, NDArray[np.float32]]:
    net = cv2.dnn.readNetFromCaffe(str(files[0]), str(files[1]))
    net.setPreferableBackend(cv2.dnn.DNN_BACKEND_OPENCV)
    blob = (image[:, ::-1] * 255 - 127.5) * 0.007843
    net.setInput(np.ascontiguousarray(blob))
    return net, net.forward()


def test_every_layer_agrees_with_opencv(files: tuple[Path, Path], rng: np.random.Generator) -> None:
    image = rng.random((1, 3, SIZE, SIZE)).astype(np.float32)
    net, _ = opencv(files, image)
    loc, conf, prior = net.forward(["loc", "flat", "prior"])
    detector = load_detector(files[1], names=NAMES)
    found = detector.dense(torch.from_numpy(image))
    corners = prior.reshape(2, -1, 4)[0]
    anchors = np.concatenate([(corners[:, :2] + corners[:, 2:]) / 2, corners[:, 2:] - corners[:, :2]], 1)
    code = loc.reshape(-1, 4)
    center = code[:, :2] * 0.1 * anchors[:, 2:] + anchors[:, :2]
    half = np.exp(code[:, 2:] * 0.2) * anchors[:, 2:] / 2
    assert np.ptp(conf) > 0.3
    np.testing.assert_allclose(found.classes[0], conf.reshape(-1, 4)[:, 1:], atol=1e-5)
    np.testing.assert_allclose(found.boxes[0], np.concatenate([center - half, center + half], 1) * SIZE, atol=1e-3)


def test_detections_agree_with_opencv(files: tuple[Path, Path], rng: np.random.Generator) -> None:
    image = rng.random((1, 3, SIZE, SIZE)).astype(np.float32)
    _, theirs = opencv(files, image)
    theirs = theirs[0, 0][theirs[0, 0, :, 1] > 0]
    ours = load_detector(files[1], names=NAMES).detect(torch.from_numpy(image), 0.9, 0.45)[0]
    assert len(ours.scores) == len(theirs) > 5
    rows = torch.cat([ours.labels[:, None] + 1, ours.scores[:, None], ours.boxes / SIZE], 1).numpy()
    theirs[:, 3:] = theirs[:, 3:].clip(0, 1)
    rows, theirs = rows[np.argsort(rows[:, 1])], theirs[np.argsort(theirs[:, 2])]
    np.testing.assert_allclose(rows, theirs[:, 1:], atol=1e-4)


def test_gradient_matches_finite_differences(files: tuple[Path, Path]) -> None:
    checked_gradient(load_detector(files[1], names=NAMES), torch.rand(2, 3, 50, 90))


def test_an_input_layer_says_the_same(files: tuple[Path, Path]) -> None:
    before = read_caffe_ssd(*files)
    new = 'layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 3 dim: 64 dim: 64 } } }'
    text = files[0].read_text()
    head = text[text.index('input: "data"') : text.index("layer {")]
    files[0].write_text(text.replace(head, new + "\n"))
    after = read_caffe_ssd(*files)
    assert (after.size, after.network.code) == (before.size, before.network.code)
    np.testing.assert_array_equal(after.anchors, before.anchors)


def test_layers_for_training_are_left_out(files: tuple[Path, Path]) -> None:
    loss = 'layer { name: "loss" type: "Frobnicate" bottom: "conv1" top: "loss" include { phase: TRAIN } }\n'
    before = read_caffe_ssd(*files)
    text = files[0].read_text()
    files[0].write_text(text.replace('layer { name: "out"', loss + 'layer { name: "out"'))
    assert read_caffe_ssd(*files).network.code == before.network.code


@pytest.mark.parametrize(
    ("before", "after", "complaint"),
    [
        (
            'type: "ReLU" bottom: "dw"',
            'type: "ELU" bottom: "dw"',
            r"every.prototxt: layer relu2 \(ELU\) is not supported; known layers are BatchNorm",
        ),
        (
            "engine: CAFFE",
            "force_nd_im2col: true",
            r"every.prototxt:\d+: unexpected .* no field named .force_nd_im2col",
        ),
        (
            "num_output: 12",
            "num_output: 13",
            r"holds \(12, 8, 1, 1\), \(12,\) for the layer pw .* takes \(13, 8, 1, 1\), \(13,\); these are",
        ),
        ('name: "pw"', 'name: "pv"', r"every.caffemodel: holds nothing for the layer pv"),
        ("num_output: 12", "num_output: 12 num_output: 12", r"every.prototxt:\d+: unexpected .* multiple"),
        ("num_output: 12 ", "", r"which takes \(0, 8, 1, 1\)"),
        ("group: 2", "group: 5", r"5 groups for 12 channels in and 6 out"),
        ("dilation: 2", "dilation: 1000000", r"a kernel_size, pad, stride or dilation beyond 1 to 64"),
        (
            'bottom: "dw" top: "pw"',
            'bottom: "pw" top: "pw"',
            r"layer pw \(Convolution\) reads pw, which no layer before it makes",
        ),
        ("kernel_size: 3 stride: 2 group: 2", "kernel_size: 33 group: 2", r"another network"),
        ("input_shape { dim: 1 dim: 3 dim: 64 dim: 64", "input_shape { dim: 1 dim: 3 dim: 4 dim: 4", r"fit its inputs"),
        ("use_global_stats: true", "use_global_stats: false", r"normalizes by its own batch"),
        ("order: 0 order: 2 order: 3 order: 1", "order: 0 order: 1 order: 2 order: 3", r"permutes to \[0, 1, 2, 3\]"),
        ("min_size: 12.0", "", r"layer prior1 \(PriorBox\) needs positive sizes"),
        ("min_size: 12.0", "min_size: nan", r"has an option that is not finite"),
        ("max_size: 20", "max_size: 20 max_size: 30", r"as many max_size as min_size or none"),
        ("step: 9", "step: 0", r"needs one positive step"),
        ("code_type: CENTER_SIZE", "code_type: CORNER", r"has another code_type than the only one that is supported"),
        ("num_classes: 4", "num_classes: 5", r"4 score columns, but 5 are declared"),
        ("aspect_ratio: 3.0 ", "", r"[0-9]+ anchors, but heads of [0-9]+ boxes"),
        ("dim: -1 dim: 4", "dim: -1 dim: 5", r"layer confr \(Reshape\) does not fit its inputs \(shape"),
        ("dim: 64 dim: 64", "dim: 64 dim: 32", r"takes 1 inputs, of shape \[1, 3, 64, 32\]"),
        ('input: "data"', 'input: "data" } ', r"every.prototxt:3: unexpected"),
        ('type: "DetectionOutput"', 'type: "Softmax"', r"has an option detection_output_param that is not supported"),
    ],
)
def test_a_wrong_description_is_refused(files: tuple[Path, Path], before: str, after: str, complaint: str) -> None:
    text = files[0].read_text()
    assert before in text
    files[0].write_text(text.replace(before, after, 1))
    with pytest.raises(RaucaError, match=complaint) as refusal:
        load_detector(files[1], names=NAMES)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"\x89PNG\r\n", b"{", b"}", b"layer", b"layer: {"])
def test_something_else_than_a_description_is_refused(files: tuple[Path, Path], content: bytes) -> None:
    files[0].write_bytes(content)
    with pytest.raises(RaucaError, match=r"every\.prototxt"):
        load_detector(files[1], names=NAMES)


@pytest.mark.parametrize(("cut", "step"), [(0, 83), (1, 211)])
def test_a_file_cut_off_anywhere_is_refused(files: tuple[Path, Path], cut: int, step: int) -> None:
    data = files[cut].read_bytes().rstrip()
    for length in range(0, len(data) - 1, step):
        files[cut].write_bytes(data[:length])
        with pytest.raises(RaucaError, match=rf"every\{files[cut].suffix}"):
            load_detector(files[1], names=NAMES)


def test_weights_that_are_wrong_are_named(files: tuple[Path, Path]) -> None:
    weights = random_weights()
    weights["pw"][0][3, 2] = np.inf
    save(files[1], weights)
    with pytest.raises(RaucaError, match=r"every\.caffemodel: layer pw holds values that are not finite"):
        load_detector(files[1], names=NAMES)
    liar = write("BlobProto", data=[1.0, 2.0], shape=write("BlobShape", dim=[2**40, 2**40]))
    layer = write("LayerParameter", name="pw", blobs=[liar])
    for field, complaint in (("layer", r"layer pw holds 2 values for a shape of \["), ("layers", "of before 2014")):
        files[1].write_bytes(write("NetParameter", **{field: [layer]}))
        with pytest.raises(RaucaError, match=complaint):
            load_detector(files[1], names=NAMES)


def test_class_lists_are_checked_and_files_make_the_fingerprint(files: tuple[Path, Path]) -> None:
    with pytest.raises(RaucaError, match=r"every\.prototxt: the network predicts 3 classes; 4 class names were given"):
        load_detector(files[1], names=(*NAMES, "kite"))
    first = load_detector(files[1], names=NAMES).fingerprint
    assert load_detector(files[1], names=NAMES).fingerprint == first
    weights: dict[str, Any] = random_weights()
    weights["pw"][0][0, 0] += 1e-3
    save(files[1], weights)
    assert load_detector(files[1], names=NAMES).fingerprint != first


def test_options_that_are_not_given_are_caffes(tmp_path: Path) -> None:
    text = "layer { name: 'x y' # no: more\n prior_box_param { min_size: 1e-3 } convolution_param {} include {} }"
    (tmp_path / "a.prototxt").write_text(text)
    (layer,) = read_prototxt(tmp_path / "a.prototxt").layer
    anchors, convolution = layer.prior_box_param, layer.convolution_param
    assert (layer.name, list(anchors.min_size), layer.include[0].phase) == ("x y", [1e-3], 1)
    assert (anchors.flip, anchors.clip, anchors.offset, layer.batch_norm_param.eps) == (True, False, 0.5, 1e-5)
    assert (convolution.stride, convolution.group, convolution.pad, convolution.bias_term) == (1, 1, 0, True)
