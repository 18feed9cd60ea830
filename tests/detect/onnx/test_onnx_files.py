"""Damaged, hostile and unsuitable ONNX files: one error each, naming the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper

from rauca_core.contract import RaucaError
from rauca_core.detect import load_detector
from rauca_core.detect.onnx_graph import Session, read_graph

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


def test_not_onnx(tmp_path: Path, exported: Exported) -> None:
    path, whole = tmp_path / "text.onnx", exported("v8").read_bytes()
    for data in (b"\x93not a graph" * 50, b"", whole[: len(whole) // 2]):
        path.write_bytes(data)
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
        refused(path, "refers to .*outside.bin' outside its folder")
    (folder / "link.bin").symlink_to(tmp_path / "outside.bin")
    path = with_outside_tensor(folder / "hostile.onnx", onnx.load(exported("v8")), "link.bin")
    refused(path, "outside its folder")
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


def with_functions_tensor(path: Path, location: str) -> Path:
    """A graph of a function that holds tensors outside the file: in a branch, in a sparse one, in a default."""
    path.parent.mkdir(exist_ok=True)
    shape = {"data_type": TensorProto.FLOAT, "dims": [1], "data_location": TensorProto.EXTERNAL}
    tensors = [TensorProto(name=f"t{i}", **shape) for i in range(3)]
    for i, tensor in enumerate(tensors):
        tensor.external_data.add(key="location", value=f"{location}{i}.bin")
        (path.parent.parent / f"outside{i}.bin").write_bytes(np.float32(i + 1).tobytes())
    spot = onnx.numpy_helper.from_array(np.array([0], np.int64), "spot")
    sparse = helper.make_sparse_tensor(tensors[1], spot, [1])
    found = helper.make_tensor_value_info("same", TensorProto.FLOAT, [1])
    branch = helper.make_graph([helper.make_node("Identity", ["t0"], ["same"])], "branch", [], [found], [tensors[0]])
    default = helper.make_node("Constant", [], ["c"])
    default.attribute.add(name="value", ref_attr_name="held", type=onnx.AttributeProto.TENSOR)
    opsets = [helper.make_opsetid("", 17), helper.make_opsetid("own", 1)]
    nodes = [
        helper.make_node("Constant", [], ["yes"], value=onnx.numpy_helper.from_array(np.array(True))),
        helper.make_node("If", ["yes"], ["a"], then_branch=branch, else_branch=branch),
        helper.make_node("Constant", [], ["b"], sparse_value=sparse),
        default,
        helper.make_node("Sum", ["x", "a", "b", "c"], ["y"]),
    ]
    held = [helper.make_attribute("held", tensors[2])]
    function = helper.make_function("own", "Shift", ["x"], ["y"], nodes, opsets, attribute_protos=held)
    call = helper.make_node("Shift", ["images"], ["output0"], domain="own")
    graph = helper.make_graph([call], "graph", [IMAGES], [OUTPUT])
    model = helper.make_model(graph, functions=[function], opset_imports=opsets, ir_version=9)
    path.write_bytes(model.SerializeToString())
    return path


def test_tensors_of_functions_outside_the_folder_are_not_read(tmp_path: Path) -> None:
    path = with_functions_tensor(tmp_path / "model" / "hostile.onnx", "../outside")
    refused(path, "refers to .*outside0.bin' outside its folder")


def test_tensors_of_functions_beside_the_file_count(tmp_path: Path) -> None:
    path = with_functions_tensor(tmp_path / "model" / "split.onnx", "outside")
    files = [(tmp_path / f"outside{i}.bin").rename(path.parent / f"outside{i}.bin") for i in range(3)]
    image = torch.zeros(1, 3, 64, 64)
    graph = read_graph(path)
    assert Session(graph)(image)[0].unique().tolist() == [1 + 2 + 3]
    for i, file in enumerate(files):
        file.write_bytes(np.float32(10).tobytes())
        changed = read_graph(path)
        assert changed.sha256 != graph.sha256
        assert Session(changed)(image)[0].unique().tolist() == [[15, 23, 30][i]]
        graph = changed


def test_inputs_that_are_no_images(tmp_path: Path) -> None:
    identity = helper.make_node("Identity", ["images"], ["output0"])
    second = helper.make_tensor_value_info("sizes", TensorProto.FLOAT, [1, 2])
    refused(saved(tmp_path / "two.onnx", identity, inputs=(IMAGES, second)), "has 2 inputs, expected one batch")
    for shape, match in (
        ([1, 64, 64], "has 3 axes"),
        ([1, 1, 64, 64], "has 1 channels"),
    ):
        images = helper.make_tensor_value_info("images", TensorProto.FLOAT, shape)
        refused(saved(tmp_path / "input.onnx", identity, inputs=(images,)), match)


def test_a_batch_that_would_fill_the_memory(tmp_path: Path) -> None:
    images = helper.make_tensor_value_info("images", TensorProto.FLOAT, [2**30, 3, 64, 64])
    path = saved(tmp_path / "batch.onnx", helper.make_node("Identity", ["images"], ["output0"]), inputs=(images,))
    refused(path, "takes 1073741824 images at once")


def test_an_output_that_is_no_detection(tmp_path: Path) -> None:
    path = saved(tmp_path / "identity.onnx", helper.make_node("Identity", ["images"], ["output0"]))
    refused(path, r"gives output0 \(1, 3, 64, 64\) for 64 x 64 pixels, no known output .*`yolo export model=best.pt")


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
