"""The wire reader against Google's protobuf library, and against bytes that nobody should trust."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy
from numpy.typing import NDArray

from rauca_core.contract import RaucaError
from rauca_core.detect.graphs.caffe_file import read_blobs
from rauca_core.detect.graphs.tensorflow_file import Node, read_graph
from rauca_core.detect.graphs.wire import Kind, Message

HERE = Path("hostile.pb")
EVERY_KIND = {1: Kind.BYTES, 2: Kind.INTEGER, 3: Kind.FLOAT32, 4: Kind.FLOAT64, 7: Kind.BYTES, 8: Kind.BYTES}
SHAPES = st_numpy.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4)
DTYPES = st.sampled_from([np.dtype("float32"), np.dtype("int32"), np.dtype("int64"), np.dtype("float64")])
TYPES = {"float32": 1, "float64": 2, "int32": 3, "int64": 9}
FIELDS = {"float32": "float_val", "float64": "double_val", "int32": "int_val", "int64": "int64_val"}


def const(proto: SimpleNamespace, tensor: object) -> Node:
    value = proto.AttrValue(tensor=tensor)
    entries = [memoryview(proto.Entry(key="value", value=value).SerializeToString())]
    return Node(HERE, "c", "Const", (), entries)


@given(
    values=DTYPES.flatmap(lambda dtype: st_numpy.arrays(dtype, SHAPES)),
    typed=st.booleans(),
)
def test_tensors_survive(proto: SimpleNamespace, values: NDArray[np.generic], typed: bool) -> None:
    shape = proto.TensorShape(dim=[proto.Dim(size=extent) for extent in values.shape])
    tensor = proto.TensorProto(dtype=TYPES[values.dtype.name], tensor_shape=shape)
    if typed:
        getattr(tensor, FIELDS[values.dtype.name]).extend(values.reshape(-1).tolist())
    else:
        tensor.tensor_content = values.tobytes()
    found = const(proto, tensor).tensor()
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found, values)


@given(
    integer=st.integers(-(2**63), 2**63 - 1),
    integers=st.lists(st.integers(-(2**63), 2**63 - 1)),
    text=st.text(),
    number=st.floats(width=32, allow_nan=False, allow_infinity=False),
    flag=st.booleans(),
)
def test_attributes_survive(
    proto: SimpleNamespace, integer: int, integers: list[int], text: str, number: float, flag: bool
) -> None:
    values = {
        "i": proto.AttrValue(i=integer),
        "list": proto.AttrValue(list=proto.ListValue(i=integers)),
        "s": proto.AttrValue(s=text.encode()),
        "f": proto.AttrValue(f=number),
        "b": proto.AttrValue(b=flag),
        "type": proto.AttrValue(type=9),
        "shape": proto.AttrValue(shape=proto.TensorShape(dim=[proto.Dim(size=-1, name="n"), proto.Dim(size=3)])),
    }
    entries = [memoryview(proto.Entry(key=key, value=value).SerializeToString()) for key, value in values.items()]
    node = Node(HERE, "n", "Op", (), entries)
    assert (node.integer("i"), node.integers("list", []), node.text("s", "")) == (integer, integers, text)
    assert (node.number("f"), node.flag("b", not flag), node.type("type"), node.shape("shape")) == (
        number,
        flag,
        9,
        (-1, 3),
    )
    assert (node.integer("none", 4), node.flag("none", True), node.text("none", "x")) == (4, True, "x")
    with pytest.raises(RaucaError, match=r"hostile\.pb: node n \(Op\) has no attribute none"):
        node.integer("none")


@given(
    names=st.lists(st.text(min_size=1), unique=True, min_size=1, max_size=5),
    shapes=st.lists(st_numpy.array_shapes(max_dims=4, max_side=4), min_size=1, max_size=3),
    old=st.booleans(),
)
@settings(max_examples=50)
def test_caffemodels_survive(
    proto: SimpleNamespace,
    tmp_path_factory: pytest.TempPathFactory,
    names: list[str],
    shapes: list[tuple[int, ...]],
    old: bool,
) -> None:
    net, expected = proto.NetParameter(name="n"), {}
    for name in names:
        blobs = [
            np.arange(np.prod(shape), dtype=np.float32).reshape((1,) * (4 - len(shape)) + shape) for shape in shapes
        ]
        written = [
            proto.BlobProto(
                data=b.reshape(-1), **dict(zip(("num", "channels", "height", "width"), b.shape, strict=True))
            )
            if old
            else proto.BlobProto(data=b.reshape(-1), shape=proto.BlobShape(dim=b.shape))
            for b in blobs
        ]
        net.layer.append(proto.LayerParameter(name=name, type="Convolution", blobs=written))
        expected[name] = blobs
    path = tmp_path_factory.mktemp("caffe") / "n.caffemodel"
    path.write_bytes(net.SerializeToString())
    found = read_blobs(path)
    assert list(found) == names
    for name in names:
        for mine, theirs in zip(found[name], expected[name], strict=True):
            np.testing.assert_array_equal(mine, theirs)


def refusal_of(attempt: Callable[[], object]) -> str | None:
    """What a RaucaError said; any other error is a fault of the reader."""
    try:
        attempt()
    except RaucaError as error:
        return str(error)
    return None


def read_everything(data: bytes) -> None:
    message = Message(HERE, memoryview(data), EVERY_KIND)
    for number, kind in EVERY_KIND.items():
        if kind is Kind.BYTES:
            message.texts(number)
        elif kind is Kind.INTEGER:
            message.integers(number)
        else:
            message.floats(number)


@given(data=st.binary(max_size=64))
@settings(max_examples=500)
def test_any_bytes_are_read_or_refused_in_one_line(data: bytes) -> None:
    refusal = refusal_of(lambda: read_everything(data))
    assert refusal is None or re.fullmatch(r"hostile\.pb: .+", refusal)


@given(where=st.integers(0, 10**6), value=st.integers(0, 255))
@settings(max_examples=200)
def test_a_changed_byte_is_read_or_refused(
    proto: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory, where: int, value: int
) -> None:
    tensor = proto.TensorProto(dtype=1, tensor_shape=proto.TensorShape(dim=[proto.Dim(size=2)]), float_val=[1.0, 2.0])
    entries = [
        proto.Entry(key="value", value=proto.AttrValue(tensor=tensor)),
        proto.Entry(key="dtype", value=proto.AttrValue(type=1)),
    ]
    data = bytearray(proto.GraphDef(node=[proto.NodeDef(name="a", op="Const", attr=entries)]).SerializeToString())
    data[where % len(data)] = value
    path = tmp_path_factory.mktemp("changed") / "changed.pb"
    path.write_bytes(data)
    refusal = refusal_of(lambda: [node.tensor() for node in read_graph(path).values()])
    assert refusal is None or "changed.pb: " in refusal


@pytest.mark.parametrize(
    ("data", "complaint"),
    [
        (b"\x0a\xff\xff\xff\xff\xff\xff\xff\xff\x7f", r"claims 9223372036854775807 bytes where 0 are left"),
        (b"\x0a\x05abc", r"claims 5 bytes where 3 are left"),
        (b"\x10" + b"\x80" * 12, r"a number has no end"),
        (b"\x10\x80", r"a number has no end"),
        (b"\x0b\x0c", r"wire type 3 is not protobuf as graphs use it"),
        (b"\x08\x01", r"field 1 has wire type 0, expected 2"),
        (b"\x15\x00\x00\x00\x00", r"field 2 has wire type 5, expected 0"),
        (b"\x1a\x03abc", r"field 3 ends inside a number"),
        (b"\x0a\x02\xff\xfe", r"field 1 is not text"),
        (b"\x02\x01a", r"a field claims 1 bytes where 1 are left"),
    ],
)
def test_hostile_bytes_are_named(data: bytes, complaint: str) -> None:
    with pytest.raises(RaucaError, match=complaint):
        read_everything(data)


def test_too_many_fields_are_refused() -> None:
    with pytest.raises(RaucaError, match=r"a message of more than 10 fields"):
        Message(HERE, memoryview(b"\x10\x01" * 11), EVERY_KIND, limit=10)
    assert Message(HERE, memoryview(b"\x10\x01" * 10), EVERY_KIND, limit=10).integers(2) == [1] * 10


@pytest.mark.parametrize(
    ("extents", "values", "complaint"),
    [
        ((2**20, 2**20), [1.0], r"declares a tensor of shape \(1048576, 1048576\); at most 67108864"),
        ((2**62, 4, 0), [], r"does not hold|declares|holds"),
        ((-1, 3), [1.0], r"declares a tensor of shape \(-1, 3\)"),
        ((2,), [1.0, 2.0, 3.0], r"holds 3 values where its shape takes 2"),
        ((2,), [], r"holds 0 values where its shape takes 2"),
    ],
)
def test_tensors_that_declare_what_they_do_not_hold(
    proto: SimpleNamespace, extents: tuple[int, ...], values: list[float], complaint: str
) -> None:
    shape = proto.TensorShape(dim=[proto.Dim(size=extent) for extent in extents])
    with pytest.raises(RaucaError, match=complaint):
        const(proto, proto.TensorProto(dtype=1, tensor_shape=shape, float_val=values)).tensor()


def test_one_value_stands_for_all_and_the_last_for_the_rest(proto: SimpleNamespace) -> None:
    shape = proto.TensorShape(dim=[proto.Dim(size=2**13), proto.Dim(size=2**13)])
    huge = const(proto, proto.TensorProto(dtype=1, tensor_shape=shape, float_val=[3.0])).tensor()
    assert huge.shape == (2**13, 2**13)
    assert huge.strides == (0, 0)  # no memory was taken
    four = proto.TensorShape(dim=[proto.Dim(size=4)])
    rest = const(proto, proto.TensorProto(dtype=3, tensor_shape=four, int_val=[1, 7])).tensor()
    assert rest.tolist() == [1, 7, 7, 7]


def test_a_type_nobody_needs_is_named(proto: SimpleNamespace) -> None:
    with pytest.raises(RaucaError, match=r"is a tensor of TensorFlow's type 7; known are \[1, 2, 3, 9, 10\]"):
        const(proto, proto.TensorProto(dtype=7)).tensor()
    with pytest.raises(RaucaError, match=r"holds 5 bytes where its shape takes 4"):
        const(proto, proto.TensorProto(dtype=1, tensor_content=b"12345")).tensor()


def test_two_nodes_of_one_name_are_refused(proto: SimpleNamespace, tmp_path: Path) -> None:
    node = proto.NodeDef(name="a", op="Const")
    (tmp_path / "twice.pb").write_bytes(proto.GraphDef(node=[node, node]).SerializeToString())
    with pytest.raises(RaucaError, match=r"twice\.pb: two nodes are called a"):
        read_graph(tmp_path / "twice.pb")
