"""A frozen TensorFlow graph (GraphDef) as nodes; attributes are parsed when they are asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ...contract import RaucaError
from .messages import BINARY, parse, read_file

MAX_NODES = 100_000
MAX_AXES = 16
MAX_ELEMENTS = 2**26  # of one tensor; the largest of these networks has 2 million

# DataType: (numpy's, the field of a TensorProto that holds few values)
_DTYPES: dict[int, tuple[str, str]] = {
    1: ("<f4", "float_val"),
    2: ("<f8", "double_val"),
    3: ("<i4", "int_val"),
    9: ("<i8", "int64_val"),
    10: ("?", "bool_val"),
}


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
    entries: Sequence[bytes]

    def fail(self, what: str) -> NoReturn:
        raise RaucaError(f"{self.path}: node {self.name} ({self.op}) {what}")

    def get(self, name: str, field: str, default: Any = None) -> Any:
        """An attribute, by the field of ``AttrValue`` that holds it; refused where absent and without a default."""
        for data in self.entries:
            entry = parse(BINARY.Entry, data, self.path)
            if entry.key == name:
                return getattr(parse(BINARY.AttrValue, entry.value, self.path), field)
        if default is None:
            self.fail(f"has no attribute {name}")
        return default

    def number(self, name: str) -> float:
        """A finite float attribute."""
        value = float(self.get(name, "f"))
        if not math.isfinite(value):
            self.fail(f"has an attribute {name} that is not finite")
        return value

    def integers(self, name: str, default: list[int]) -> list[int]:
        """An attribute that is a list of integers; absent or empty it is ``default``."""
        return list(parse(BINARY.ListValue, self.get(name, "list", b""), self.path).i) or default

    def shape(self, data: bytes) -> tuple[int, ...]:
        """Of a ``TensorShape``; -1 where unknown."""
        dims = parse(BINARY.TensorShape, data, self.path).dim
        if len(dims) > MAX_AXES:
            self.fail(f"declares a shape of {len(dims)} axes")
        return tuple(parse(BINARY.Dim, dim, self.path).size for dim in dims)

    def tensor(self) -> NDArray[Any]:
        """The value of a ``Const``.

        Raises:
            RaucaError: no value, another type than float, int or bool, fewer or more values than its shape holds.
        """
        message = parse(BINARY.TensorProto, self.get("value", "tensor"), self.path)
        if message.dtype not in _DTYPES:
            self.fail(f"is a tensor of TensorFlow's type {message.dtype}; known are {sorted(_DTYPES)}")
        dtype, field = np.dtype(_DTYPES[message.dtype][0]), _DTYPES[message.dtype][1]
        shape = self.shape(message.tensor_shape)
        count = math.prod(shape)
        if not all(0 <= extent <= MAX_ELEMENTS for extent in (*shape, count)):
            self.fail(f"declares a tensor of shape {shape}; at most {MAX_ELEMENTS} elements are read")
        if message.tensor_content:
            if len(message.tensor_content) != count * dtype.itemsize:
                self.fail(f"holds {len(message.tensor_content)} bytes where its shape takes {count * dtype.itemsize}")
            return np.frombuffer(message.tensor_content, dtype).reshape(shape)
        numbers = np.array(getattr(message, field), dtype)
        if len(numbers) > count or (count and not len(numbers)):
            self.fail(f"holds {len(numbers)} values where its shape takes {count}")
        if len(numbers) == 1:  # stands for all, without their memory
            return np.broadcast_to(numbers, count).reshape(shape)
        return (np.pad(numbers, (0, count - len(numbers)), mode="edge") if count else numbers).reshape(shape)


def read_graph(path: Path) -> dict[str, Node]:
    """Nodes by name.

    Raises:
        RaucaError: missing, cut off or damaged file, too many nodes, two nodes of one name.
    """
    found = read_file(BINARY.GraphDef, path).node
    if not 0 < len(found) <= MAX_NODES:
        raise RaucaError(
            f"{path}: holds {len(found)} nodes; a frozen TensorFlow graph of a detector has some thousands"
        )
    nodes: dict[str, Node] = {}
    for data in found:
        node = parse(BINARY.NodeDef, data, path)
        if not node.name or not node.op:
            raise RaucaError(f"{path}: holds a node without a name or operator; this is no frozen TensorFlow graph")
        if node.name in nodes:
            raise RaucaError(f"{path}: two nodes are called {node.name}")
        inputs = tuple(name.removesuffix(":0") for name in node.input if not name.startswith("^"))
        nodes[node.name] = Node(path, node.name, node.op, inputs, node.attr)
    return nodes
