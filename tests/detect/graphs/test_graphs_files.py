"""What graphs and caffemodels hold, and files that claim what they do not hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy
from numpy.typing import NDArray

from rauca_core.contract import RaucaError
from rauca_core.detect.graphs.caffe import read_blobs
from rauca_core.detect.graphs.tensorflow_file import MAX_NODES, Node, read_graph
from tests.detect.graphs.conftest import TYPES, attribute, tensor_shape, write

HERE = Path("hostile.pb")
SHAPES = st_numpy.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4)
DTYPES = st.sampled_from([np.dtype("float32"), np.dtype("int32"), np.dtype("int64"), np.dtype("float64")])
FIELDS = {"float32": "float_val", "float64": "double_val", "int32": "int_val", "int64": "int64_val"}


def const(**tensor: object) -> Node:
    value = write("AttrValue", tensor=write("TensorProto", **tensor))
    return Node(HERE, "c", "Const", (), [write("Entry", key="value", value=value)])


@given(values=DTYPES.flatmap(lambda dtype: st_numpy.arrays(dtype, SHAPES)), typed=st.booleans())
def test_tensors_survive(values: NDArray[np.generic], typed: bool) -> None:
    name = values.dtype.name
    held = {FIELDS[name]: values.reshape(-1).tolist()} if typed else {"tensor_content": values.tobytes()}
    found = const(dtype=TYPES[name], tensor_shape=tensor_shape(values.shape), **held).tensor()
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found, values)


def test_attributes_survive() -> None:
    values = {"i": -3, "list": [2, 2**40], "s": "NHWC", "f": 0.5, "b": True, "shape": (-1, 3)}
    node = Node(HERE, "n", "Op", (), [write("Entry", key=k, value=attribute(v)) for k, v in values.items()])
    assert (node.get("i", "i"), node.get("s", "s"), node.get("b", "b"), node.number("f")) == (-3, "NHWC", True, 0.5)
    assert (node.integers("list", []), node.shape(node.get("shape", "shape"))) == ([2, 2**40], (-1, 3))
    assert (node.get("none", "i", 4), node.integers("none", [1])) == (4, [1])
    with pytest.raises(RaucaError, match=r"hostile\.pb: node n \(Op\) has no attribute none"):
        node.get("none", "i")


@given(
    names=st.lists(st.text(min_size=1), unique=True, min_size=1, max_size=5),
    shapes=st.lists(st_numpy.array_shapes(max_dims=4, max_side=4), min_size=1, max_size=3),
    old=st.booleans(),
)
@settings(max_examples=50)
def test_caffemodels_survive(
    tmp_path_factory: pytest.TempPathFactory, names: list[str], shapes: list[tuple[int, ...]], old: bool
) -> None:
    blobs = [np.arange(np.prod(shape), dtype=np.float32).reshape((1,) * (4 - len(shape)) + shape) for shape in shapes]
    written = []
    for blob in blobs:
        extents = dict(zip(("num", "channels", "height", "width"), blob.shape, strict=True))
        shape = extents if old else {"shape": write("BlobShape", dim=blob.shape)}
        written.append(write("BlobProto", data=blob.reshape(-1), **shape))
    layers = [write("LayerParameter", name=name, type="Convolution", blobs=written) for name in names]
    path = tmp_path_factory.mktemp("caffe") / "n.caffemodel"
    path.write_bytes(write("NetParameter", name="n", layer=layers))
    found = read_blobs(path)
    assert list(found) == names
    for name in names:
        for mine, theirs in zip(found[name], blobs, strict=True):
            np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize(
    ("extents", "values", "complaint"),
    [
        ((2**20, 2**20), [1.0], r"declares a tensor of shape \(1048576, 1048576\); at most 67108864"),
        ((2**62, 4, 0), [], r"declares a tensor of shape"),
        ((-1, 3), [1.0], r"declares a tensor of shape \(-1, 3\)"),
        ((1,) * 17, [1.0], r"declares a shape of 17 axes"),
        ((2,), [1.0, 2.0, 3.0], r"holds 3 values where its shape takes 2"),
        ((2,), [], r"holds 0 values where its shape takes 2"),
    ],
)
def test_tensors_that_declare_what_they_do_not_hold(
    extents: tuple[int, ...], values: list[float], complaint: str
) -> None:
    with pytest.raises(RaucaError, match=complaint):
        const(dtype=1, tensor_shape=tensor_shape(extents), float_val=values).tensor()


def test_one_value_stands_for_all_and_the_last_for_the_rest() -> None:
    huge = const(dtype=1, tensor_shape=tensor_shape((2**13, 2**13)), float_val=[3.0]).tensor()
    assert huge.shape == (2**13, 2**13)
    assert huge.strides == (0, 0)  # no memory was taken
    assert const(dtype=3, tensor_shape=tensor_shape((4,)), int_val=[1, 7]).tensor().tolist() == [1, 7, 7, 7]


def test_a_type_nobody_needs_is_named() -> None:
    with pytest.raises(RaucaError, match=r"is a tensor of TensorFlow's type 7; known are \[1, 2, 3, 9, 10\]"):
        const(dtype=7).tensor()
    with pytest.raises(RaucaError, match=r"holds 5 bytes where its shape takes 4"):
        const(dtype=1, tensor_content=b"12345").tensor()


@pytest.mark.parametrize(
    ("data", "complaint"),
    [
        (write("GraphDef"), r"holds 0 nodes"),
        (b"\x0a\x00" * (MAX_NODES + 1), r"holds 100001 nodes"),
        (write("GraphDef", node=[write("NodeDef", name="a", op="Const")] * 2), r"two nodes are called a"),
        (write("GraphDef", node=[write("NodeDef", name="a")]), r"holds a node without a name or operator"),
        (write("GraphDef", node=[b"\x0a\x02\xff\xfe"]), r"holds no NodeDef where one belongs"),
        (b"\x0a\x05abc", r"holds no GraphDef where one belongs; cut off, damaged"),
        (b"\x0b" * 10_000, r"holds no GraphDef"),
    ],
)
def test_what_is_no_graph_is_refused(tmp_path: Path, data: bytes, complaint: str) -> None:
    (tmp_path / "no.pb").write_bytes(data)
    with pytest.raises(RaucaError, match=rf"no\.pb: {complaint}"):
        read_graph(tmp_path / "no.pb")
