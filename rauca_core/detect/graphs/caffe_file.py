"""Caffe's two files: a network's description in protobuf's text format, and the weights of its layers (caffemodel)."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from ...contract import RaucaError
from ...contract.reading import read_text
from .wire import Kind, Message, read_file

MAX_BYTES = 2**20
MAX_DEPTH = 16

# Everything that is no token lies between the matches: white space and comments, or something that is refused.
_TOKEN = re.compile(r'#[^\n]*|[{}:]|"[^"\n]*"|\'[^\'\n]*\'|[^\s{}:"\'#]+|\S')


@dataclass
class Block:
    """What stands between braces: values and blocks by their names, each as often as it is given.

    Attributes:
        line: where it begins.
    """

    path: Path
    line: int
    kind: str = "network"
    values: dict[str, list[str]] = field(default_factory=dict)
    blocks: dict[str, list[Block]] = field(default_factory=dict)

    def fail(self, what: str) -> NoReturn:
        raise RaucaError(f"{self.path}:{self.line}: {self.kind} {what}")

    def only(self, known: frozenset[str]) -> None:
        """Refuse anything that could change the computation and is not known."""
        unknown = sorted({*self.values, *self.blocks} - known)
        if unknown:
            self.fail(f"has an option {unknown[0]} that is not supported; known are {', '.join(sorted(known))}")

    def block(self, name: str) -> Block:
        """The one block of that name; an empty one when it is not given."""
        found = self.blocks.get(name, [])
        if len(found) > 1:
            self.fail(f"has {len(found)} blocks {name}, expected one")
        return found[0] if found else Block(self.path, self.line, f"{self.kind}, {name}")

    def text(self, name: str, default: str | None = None) -> str:
        found = self.values.get(name, [])
        if len(found) != 1 and not (not found and default is not None):
            self.fail(f"has {len(found)} values {name}, expected one")
        return found[0] if found else default or ""

    def integer(self, name: str, default: int | None = None, minimum: int = 0, maximum: int = 65536) -> int:
        text = self.text(name, None if default is None else str(default))
        try:
            value = int(text)
        except ValueError:
            value = minimum - 1
        if not minimum <= value <= maximum:
            self.fail(f"has {name}: {text}, expected a whole number between {minimum} and {maximum}")
        return value

    def integers(self, name: str) -> list[int]:
        try:
            return [int(text) for text in self.values.get(name, [])]
        except ValueError:
            self.fail(f"has a value of {name} that is no whole number")

    def numbers(self, name: str, default: list[float] | None = None) -> list[float]:
        try:
            values = [float(text) for text in self.values.get(name, [])]
        except ValueError:
            self.fail(f"has a value of {name} that is no number")
        if not all(abs(value) < 1e6 for value in values):
            self.fail(f"has a value of {name} that is not finite, or far too large")
        return values or default or []

    def flag(self, name: str, default: bool) -> bool:
        text = self.text(name, "true" if default else "false")
        if text not in ("true", "false"):
            self.fail(f"has {name}: {text}, expected true or false")
        return text == "true"


def read_prototxt(path: Path) -> Block:
    """Read a network's description.

    Raises:
        RaucaError: missing file, braces that do not match, anything else than ``name: value`` and ``name { ... }``.
    """
    root = Block(path, 1)
    open_blocks, name, colon, line = [root], "", False, 1
    for line, token in _tokens(path):
        current = open_blocks[-1]
        if token == "}" and not name and len(open_blocks) > 1:
            open_blocks.pop()
        elif token == "{" and name and len(open_blocks) < MAX_DEPTH:
            current.blocks.setdefault(name, []).append(Block(path, line, name))
            open_blocks.append(current.blocks[name][-1])
            name, colon = "", False
        elif token == ":" and name and not colon:
            colon = True
        elif token not in ("{", "}", ":", '"', "'") and name and colon:
            current.values.setdefault(name, []).append(token.strip("\"'"))
            name, colon = "", False
        elif token.isidentifier() and not name:
            name = token
        else:
            raise RaucaError(f"{path}:{line}: unexpected {token[:40]!r}; this is no caffe network in text")
    if len(open_blocks) > 1 or name:
        raise RaucaError(f"{path}:{line}: ends inside {name or open_blocks[-1].kind}; the file is cut off")
    return root


def _tokens(path: Path) -> list[tuple[int, str]]:
    lines = read_text(path, MAX_BYTES, "a caffe network in text").splitlines()
    found = [(number, token) for number, line in enumerate(lines, 1) for token in _TOKEN.findall(line)]
    return [(number, token) for number, token in found if not token.startswith("#")]


MAX_LAYERS = 10_000

# Field numbers of caffe.proto
_NET = {2: Kind.BYTES, 100: Kind.BYTES}
_LAYER = {1: Kind.BYTES, 7: Kind.BYTES}
_BLOB = {
    1: Kind.INTEGER,
    2: Kind.INTEGER,
    3: Kind.INTEGER,
    4: Kind.INTEGER,
    5: Kind.FLOAT32,
    7: Kind.BYTES,
    8: Kind.FLOAT64,
}
_SHAPE = {1: Kind.INTEGER}


def read_blobs(path: Path) -> dict[str, list[NDArray[Any]]]:
    """Weights in the order in which each layer holds them.

    Raises:
        RaucaError: missing, cut off or damaged file, a file of caffe's old format, values that do not fill a shape.
    """
    net = Message(path, read_file(path), _NET, MAX_LAYERS)
    if 2 in net:
        raise RaucaError(f"{path}: is in caffe's format of before 2014; upgrade it with upgrade_net_proto_binary")
    found: dict[str, list[NDArray[Any]]] = {}
    for data in net.messages(100):
        layer = Message(path, data, _LAYER)
        blobs = [_read_blob(path, layer.text(1), blob) for blob in layer.messages(7)]
        if layer.text(1) in found and blobs:
            raise RaucaError(f"{path}: two layers are called {layer.text(1)}")
        found.setdefault(layer.text(1), blobs)
    if not any(found.values()):
        raise RaucaError(f"{path}: holds no weights; this is no caffemodel")
    return found


def _read_blob(path: Path, layer: str, data: memoryview) -> NDArray[Any]:
    blob = Message(path, data, _BLOB, limit=2**24)
    values = blob.floats(5) if 5 in blob else blob.floats(8)
    if 7 in blob:
        shape = Message(path, blob.messages(7)[-1], _SHAPE, limit=16).integers(1)
    else:  # before blobs had shapes they were always num, channels, height, width
        shape = [blob.integer(number) for number in (1, 2, 3, 4)]
    if not all(0 < extent < 2**31 for extent in shape) or math.prod(shape) != len(values):
        raise RaucaError(f"{path}: layer {layer} holds {len(values)} values for a shape of {shape}; damaged file")
    if not np.isfinite(values).all():
        raise RaucaError(f"{path}: layer {layer} holds values that are not finite; damaged file")
    return values.reshape(shape)
