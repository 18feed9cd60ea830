"""Readers of detectors: whatever somebody hands over as weights."""

from __future__ import annotations

import hashlib
import json
import warnings
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file

from rauca_core.detect import load_detector
from rauca_core.detect.classes import read_names
from rauca_core.detect.frameworks.checkpoint import read_state
from rauca_core.detect.frameworks.mmdet_config import read_config
from rauca_core.detect.frameworks.scaling import Scaling, read_scaling
from rauca_core.detect.frameworks.transformers_loading import load_model
from rauca_core.detect.synth.card import load_network
from tests.detect.conftest import EVERY_LAYER, write_random_weights
from tests.detect.graphs import test_graphs_caffe as caffe
from tests.detect.graphs.conftest import ssd_graph
from tests.detect.test_frameworks_mmdet import written
from tests.detect.test_modules import small_network

from .mutate import mutate_json, mutate_text
from .target import Target

DETR = {
    "model_type": "detr", "d_model": 8, "encoder_layers": 1, "decoder_layers": 1, "num_queries": 3,
    "encoder_attention_heads": 1, "decoder_attention_heads": 1, "encoder_ffn_dim": 8, "decoder_ffn_dim": 8,
    "id2label": {"0": "car", "1": "boat"}, "use_timm_backbone": False,
    "backbone_config": {"model_type": "resnet", "embedding_size": 4, "hidden_sizes": [4, 4], "depths": [1, 1],
                        "layer_type": "basic", "out_features": ["stage2"]},
}  # fmt: skip
SCALING = {
    "size": {"shortest_edge": 800, "longest_edge": 1333}, "resample": 2,
    "image_mean": [0.4, 0.4, 0.4], "image_std": [0.2, 0.2, 0.2], "do_normalize": True,
}  # fmt: skip


def _darknet(folder: Path) -> None:
    small = EVERY_LAYER.replace("filters=16", "filters=4").replace("filters=8", "filters=4")
    (folder / "net.cfg").write_text(small)
    write_random_weights(folder / "net.weights", folder / "net.cfg")


def _read_darknet(folder: Path) -> None:
    detector = load_detector(folder / "net.weights", 32, names=("boat", "car"))
    detector.detect(torch.zeros(1, 3, 32, 32))


def _tf_server(folder: Path) -> None:
    ssd_graph(lite=False, size=9, classes=1).save(folder / "graph.pb")


def _tf_lite(folder: Path) -> None:
    ssd_graph(lite=True, size=9, classes=1).save(folder / "graph.pb")


def _read_tf(folder: Path) -> None:
    load_detector(folder / "graph.pb", names=("car",))


def _caffe(folder: Path) -> None:
    (folder / "net.prototxt").write_text(caffe.EVERY_LAYER)
    caffe.save(folder / "net.caffemodel", caffe.random_weights())


def _read_caffe(folder: Path) -> None:
    load_detector(folder / "net.caffemodel", names=caffe.NAMES)


def _onnx(folder: Path) -> None:
    """A graph with the output of a v8 export at 32 pixels: 3 classes at 16 + 4 + 1 cells."""
    from onnx import TensorProto, helper, numpy_helper, save

    rng = np.random.default_rng(2)
    weights = numpy_helper.from_array(rng.normal(0, 0.1, (48, 7 * 21)).astype("f4"), "w")
    shape = numpy_helper.from_array(np.array([1, 7, 21]), "shape")
    nodes = [
        helper.make_node("AveragePool", ["images"], ["small"], kernel_shape=[8, 8], strides=[8, 8]),
        helper.make_node("Flatten", ["small"], ["flat"]),
        helper.make_node("MatMul", ["flat", "w"], ["found"]),
        helper.make_node("Reshape", ["found", "shape"], ["output0"]),
    ]
    made = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, dims)
        for name, dims in (("images", [1, 3, 32, 32]), ("output0", [1, 7, 21]))
    ]
    graph = helper.make_graph(nodes, "g", made[:1], made[1:], [weights, shape])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    helper.set_model_props(model, {"names": "{0: 'boat', 1: 'car', 2: 'x'}", "imgsz": "[32, 32]"})
    save(model, folder / "net.onnx")


def _read_onnx(folder: Path) -> None:
    load_detector(folder / "net.onnx")


def _synth(folder: Path) -> None:
    """A card of ours; the weights behind it are another network's, which is found last."""
    save_file({"x": torch.zeros(2)}, folder / "w.safetensors")
    named = ("architecture", "licence", "caution", "backbone", "command", "remarks", "rauca", "called")
    texts = dict.fromkeys(named, "x")
    card = {"format": "rauca-detector-weights", "version": 1, "name": "frcnn-synth", "class_names": ["car"]}
    card |= {"size": 64, "data": [], "seed": 0, "steps": 1, "settings": {}, "cpu_minutes": 1.0, "metrics": {}, **texts}
    card["sha256"] = hashlib.sha256((folder / "w.safetensors").read_bytes()).hexdigest()
    (folder / "w.json").write_text(json.dumps(card))


def _state(folder: Path) -> None:
    tensors = {"a.weight": torch.ones(2, 3), "a.bias": torch.zeros(3), "n": torch.tensor(4)}
    save_file(tensors, folder / "w.safetensors")
    torch.save({"model": tensors}, folder / "w.pth")


def _transformers(folder: Path) -> None:
    save_file({"model.x": torch.zeros(2)}, folder / "model.safetensors")
    (folder / "config.json").write_text(json.dumps(DETR))


def _torchscript(folder: Path) -> None:
    with warnings.catch_warnings(action="ignore"):
        torch.jit.script(small_network()).save(str(folder / "net.torchscript"))


TARGETS = (
    Target("darknet-cfg", "net.cfg", _darknet, _read_darknet, mutate_text),
    Target("darknet-weights", "net.weights", _darknet, _read_darknet),
    Target("tensorflow-server", "graph.pb", _tf_server, _read_tf),
    Target("tensorflow-lite", "graph.pb", _tf_lite, _read_tf),
    Target("caffe-prototxt", "net.prototxt", _caffe, _read_caffe, mutate_text),
    Target("caffemodel", "net.caffemodel", _caffe, _read_caffe),
    Target("onnx", "net.onnx", _onnx, _read_onnx),
    Target(
        "torchscript",
        "net.torchscript",
        _torchscript,
        lambda f: load_detector(f / "net.torchscript", names=("car", "bus", "tree")),
    ),
    Target("names", "net.names", "boat\ncar\naeroplane\n", lambda f: read_names(f / "net.names"), mutate_text),
    Target("detector-card", "w.json", _synth, lambda f: load_network(f / "w.safetensors"), mutate_json),
    Target("state-safetensors", "w.safetensors", _state, lambda f: read_state(f / "w.safetensors")),
    Target("state-pth", "w.pth", _state, lambda f: read_state(f / "w.pth")),
    Target("transformers", "config.json", _transformers, load_model, mutate_json),
    Target(
        "preprocessor",
        "preprocessor_config.json",
        json.dumps(SCALING),
        lambda f: read_scaling(f / "preprocessor_config.json", Scaling()),
        mutate_json,
    ),
    Target("mmdet-config", "c.json", lambda f: written(f / "c.json"), lambda f: read_config(f / "c.json"), mutate_json),
)
