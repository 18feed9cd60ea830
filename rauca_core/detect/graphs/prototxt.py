"""Protobuf's text format, as caffe describes networks in it."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from ...contract import RaucaError
from ...contract.reading import read_text

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
