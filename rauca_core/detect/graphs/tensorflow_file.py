"""A frozen TensorFlow graph (GraphDef) as nodes; tensors are decoded when they are asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ...contract import RaucaError
from .wire import Kind, Message, read_file

MAX_NODES = 100_000
MAX_ELEMENTS = 2**26  # of one tensor; the largest of these networks has 2 million

# Field numbers of tensorflow/core/framework: graph.proto, node_def.proto, attr_value.proto, tensor.proto
_GRAPH = {1: Kind.BYTES}
_NODE = {1: Kind.BYTES, 2: Kind.BYTES, 3: Kind.BYTES, 5: Kind.BYTES}
_ENTRY = {1: Kind.BYTES, 2: Kind.BYTES}
_ATTR = {
    1: Kind.BYTES,  # list
    2: Kind.BYTES,  # s
    3: Kind.INTEGER,  # i
    4: Kind.FLOAT32,  # f
    5: Kind.INTEGER,  # b
    6: Kind.INTEGER,  # type
    7: Kind.BYTES,  # shape
    8: Kind.BYTES,  # tensor
}
_LIST = {3: Kind.INTEGER}
_SHAPE = {2: Kind.BYTES}
_DIM = {1: Kind.INTEGER}
_TENSOR = {
    1: Kind.INTEGER,
    2: Kind.BYTES,
    4: Kind.BYTES,
    5: Kind.FLOAT32,
    6: Kind.FLOAT64,
    7: Kind.INTEGER,
    10: Kind.INTEGER,
    11: Kind.INTEGER,
}

# DataType: (numpy's, the field of a TensorProto that holds few values)
_DTYPES: dict[int, tuple[str, int]] = {1: ("<f4", 5), 2: ("<f8", 6), 3: ("<i4", 7), 9: ("<i8", 10), 10: ("?", 11)}


@dataclass(frozen=True)
class Node:
    """One node of the graph.

    Attributes:
        op: the operator's name, e.g. ``"Conv2D"``.
        inputs: names of the nodes it reads, with ``:k`` for their outputs after the first; control inputs are left out.
        entries: its attributes as they lie in the file: most nodes of a graph are never asked for theirs.
    """

    path: Path
    name: str
    op: str
    inputs: tuple[str, ...]
    entries: list[memoryview]

    def fail(self, what: str) -> NoReturn:
        raise RaucaError(f"{self.path}: node {self.name} ({self.op}) {what}")

    def _attribute(self, name: str) -> Message | None:
        for entry in (Message(self.path, data, _ENTRY) for data in self.entries):
            if entry.text(1) == name:
                return Message(self.path, _last(entry, 2), _ATTR)
        return None

    def integer(self, name: str, default: int | None = None) -> int:
        found = self._attribute(name)
        if found is None and default is None:
            self.fail(f"has no attribute {name}")
        return (default or 0) if found is None else found.integer(3)

    def type(self, name: str) -> int:
        """TensorFlow's number of a data type; 0 when absent."""
        found = self._attribute(name)
        return 0 if found is None else found.integer(6)

    def number(self, name: str) -> float:
        """A finite float attribute."""
        found = self._attribute(name)
        if found is None:
            self.fail(f"has no attribute {name}")
        value = float(found.floats(4)[-1]) if 4 in found else 0.0
        if not math.isfinite(value):
            self.fail(f"has an attribute {name} that is not finite")
        return value

    def flag(self, name: str, default: bool) -> bool:
        found = self._attribute(name)
        return default if found is None else bool(found.integer(5))

    def text(self, name: str, default: str) -> str:
        found = self._attribute(name)
        return default if found is None else found.text(2)

    def integers(self, name: str, default: list[int]) -> list[int]:
        """An attribute that is a list of integers; absent or empty it is ``default``."""
        found = self._attribute(name)
        values = [] if found is None else Message(self.path, _last(found, 1), _LIST).integers(3)
        return values or default

    def shape(self, name: str) -> tuple[int, ...]:
        """A shape attribute; -1 where unknown, () when absent."""
        found = self._attribute(name)
        return () if found is None else _shape(self.path, _last(found, 7))

    def tensor(self) -> NDArray[Any]:
        """The value of a ``Const``.

        Raises:
            RaucaError: no value, another type than float, int or bool, fewer or more values than its shape holds.
        """
        found = self._attribute("value")
        if found is None or 8 not in found:
            self.fail("holds no tensor")
        message = Message(self.path, _last(found, 8), _TENSOR, MAX_ELEMENTS)
        if message.integer(1) not in _DTYPES:
            self.fail(f"is a tensor of TensorFlow's type {message.integer(1)}; known are {sorted(_DTYPES)}")
        dtype, field = _DTYPES[message.integer(1)]
        shape = _shape(self.path, _last(message, 2))
        count = math.prod(shape)
        if not all(0 <= extent <= MAX_ELEMENTS for extent in (*shape, count)):
            self.fail(f"declares a tensor of shape {shape}; at most {MAX_ELEMENTS} elements are read")
        return self._values(message, np.dtype(dtype), field, count).reshape(shape)

    def _values(self, message: Message, dtype: np.dtype[Any], field: int, count: int) -> NDArray[Any]:
        content = _last(message, 4)
        if len(content):
            if len(content) != count * dtype.itemsize:
                self.fail(f"holds {len(content)} bytes where its shape takes {count * dtype.itemsize}")
            return np.frombuffer(content, dtype)
        numbers = message.floats(field) if dtype.kind == "f" else np.array(message.integers(field), np.int64)
        if len(numbers) > count or (count and not len(numbers)):
            self.fail(f"holds {len(numbers)} values where its shape takes {count}")
        # one value stands for all of the same, without their memory
        if len(numbers) == 1:
            return np.broadcast_to(numbers.astype(dtype), count)
        return np.pad(numbers.astype(dtype), (0, count - len(numbers)), mode="edge") if count else numbers.astype(dtype)


def read_graph(path: Path) -> dict[str, Node]:
    """Nodes by name.

    Raises:
        RaucaError: missing, cut off or damaged file, too many nodes, two nodes of one name.
    """
    nodes: dict[str, Node] = {}
    for data in Message(path, read_file(path), _GRAPH, MAX_NODES).messages(1):
        node = _read_node(path, data)
        if not node.name or not node.op:
            raise RaucaError(f"{path}: holds a node without a name or operator; this is no frozen TensorFlow graph")
        if node.name in nodes:
            raise RaucaError(f"{path}: two nodes are called {node.name}")
        nodes[node.name] = node
    if not nodes:
        raise RaucaError(f"{path}: holds no nodes; this is no frozen TensorFlow graph")
    return nodes


def _read_node(path: Path, data: memoryview) -> Node:
    message = Message(path, data, _NODE)
    inputs = tuple(name.removesuffix(":0") for name in message.texts(3) if not name.startswith("^"))
    return Node(path, message.text(1), message.text(2), inputs, message.messages(5))


def _last(message: Message, number: int) -> memoryview:
    return message.messages(number)[-1] if number in message else memoryview(b"")


def _shape(path: Path, data: memoryview) -> tuple[int, ...]:
    dims = Message(path, data, _SHAPE, limit=16).messages(2)
    return tuple(Message(path, dim, _DIM).integer(1) for dim in dims)
