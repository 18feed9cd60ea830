"""Damaged, hostile and unsuitable ONNX files: one error each, naming the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import onnx
import pytest
from onnx import TensorProto, helper

from rauca_core.contract import RaucaError
from rauca_core.detect import load_detector

Exported = Callable[..., Path]
IMAGES = helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, 64, 64])
OUTPUT = helper.make_tensor_value_info("output0", TensorProto.FLOAT, ["a", "b", "c", "d"])


def saved(path: Path, *nodes: onnx.NodeProto, inputs: tuple[onnx.ValueInfoProto, ...] = (IMAGES,)) -> Path:
    graph = helper.make_graph(list(nodes), "graph", list(inputs), [OUTPUT])
    opsets = [helper.make_opsetid("", 17), helper.make_opsetid("com.example", 1)]
    onnx.save(helper.make_model(graph, opset_imports=opsets, ir_version=8), path)
    return path


def refused(path: Path, match: str, **options: int) -> None:
    with pytest.raises(RaucaError, match=match) as caught:
        load_detector(str(path), **options)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_not_onnx(tmp_path: Path) -> None:
    path = tmp_path / "text.onnx"
    path.write_bytes(b"\x93not a graph" * 50)
    refused(path, "not an ONNX file|not a graph that can run")
    path.write_bytes(b"")
    refused(path, "not a graph that can run")


def test_a_cut_off_file(tmp_path: Path, exported: Exported) -> None:
    path = tmp_path / "cut.onnx"
    data = exported("v8").read_bytes()
    path.write_bytes(data[: len(data) // 2])
    refused(path, "not an ONNX file|not a graph that can run")


@pytest.mark.parametrize("domain", ["", "com.example"])
def test_unknown_operator(domain: str, tmp_path: Path) -> None:
    node = helper.make_node("Frobnicate", ["images"], ["output0"], domain=domain)
    refused(saved(tmp_path / "unknown.onnx", node), "Frobnicate")


def with_outside_tensor(path: Path, model: onnx.ModelProto, location: str) -> Path:
    tensor = model.graph.initializer[0]
    data = tensor.raw_data
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    for key, value in (("location", location), ("offset", "0"), ("length", str(len(data)))):
        tensor.external_data.add(key=key, value=value)
    path.write_bytes(model.SerializeToString())
    (path.parent.parent / "outside.bin").write_bytes(data)
    return path


def test_tensors_outside_the_folder_are_not_read(tmp_path: Path, exported: Exported) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    for location in ("../outside.bin", str(tmp_path / "outside.bin")):
        path = with_outside_tensor(folder / "hostile.onnx", onnx.load(exported("v8")), location)
        refused(path, "lies outside its folder, at .*outside.bin'; refused")
    (folder / "link.bin").symlink_to(tmp_path / "outside.bin")
    path = with_outside_tensor(folder / "hostile.onnx", onnx.load(exported("v8")), "link.bin")
    refused(path, "lies outside its folder")
    path = with_outside_tensor(folder / "hostile.onnx", onnx.load(exported("v8")), "absent.bin")
    refused(path, "absent.bin is missing beside it")


def test_tensors_beside_the_file_count(tmp_path: Path, exported: Exported) -> None:
    folder = tmp_path / "model"
    folder.mkdir()
    path = with_outside_tensor(folder / "split.onnx", onnx.load(exported("v8")), "beside.bin")
    (tmp_path / "outside.bin").rename(folder / "beside.bin")
    before = load_detector(str(path)).fingerprint
    data = bytearray((folder / "beside.bin").read_bytes())
    data[0] ^= 1
    (folder / "beside.bin").write_bytes(data)
    assert load_detector(str(path)).fingerprint != before


def test_inputs_that_are_no_images(tmp_path: Path) -> None:
    identity = helper.make_node("Identity", ["images"], ["output0"])
    second = helper.make_tensor_value_info("sizes", TensorProto.FLOAT, [1, 2])
    refused(saved(tmp_path / "two.onnx", identity, inputs=(IMAGES, second)), "has 2 inputs, expected one batch")
    for shape, match in (
        ([1, 64, 64], "has 3 axes"),
        ([1, 1, 64, 64], "has 1 channels"),
        ([1, 3, 64, 32], "64 x 32 pixels, expected a square"),
        ([4, 3, 64, 64], "exported for batches of 4"),
    ):
        images = helper.make_tensor_value_info("images", TensorProto.FLOAT, shape)
        refused(saved(tmp_path / "input.onnx", identity, inputs=(images,)), match)


def test_an_output_that_is_no_detection(tmp_path: Path) -> None:
    path = saved(tmp_path / "identity.onnx", helper.make_node("Identity", ["images"], ["output0"]))
    refused(path, r"its output \(1, 3, 64, 64\) is neither YOLOX's")


def test_a_size_the_graph_was_not_made_for(exported: Exported) -> None:
    refused(exported("v8"), "exported for 64 pixels, not 96", size=96)


def test_class_names(tmp_path: Path, exported: Exported) -> None:
    path = tmp_path / "nameless.onnx"
    path.write_bytes(exported("v8", metadata=False).read_bytes())
    refused(path, "predicts 3 classes, whose names are not in it")
    names = path.with_suffix(".names")
    names.write_text("car\nboat\nbus\n")
    assert load_detector(str(path)).class_names == ("car", "boat", "bus")
    names.write_text("car\nboat\n")
    refused(path, "predicts 3 classes, 2 names were given")
