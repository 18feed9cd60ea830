"""Protobuf's wire format, read by a schema of the few fields that matter.

Why not the protobuf package: a reader by schema can only nest as deeply as its schemas do, never copies a tensor, and
refuses before it allocates; a message parser turns two hostile bytes into a whole object first. Both need the field
numbers written down once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...contract import RaucaError
from ...contract.reading import read_limited

MAX_FILE_BYTES = 2**29  # the largest of these detectors' files have 250 MB
MAX_PACKED = 2**20  # integers are shapes and indices; as Python's, one byte of the file becomes forty
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_FIXED_SIZE = {_FIXED64: 8, _FIXED32: 4}


class Kind(IntEnum):
    """What a field holds; numbers may be repeated, packed or not."""

    INTEGER = _VARINT
    BYTES = _BYTES
    FLOAT32 = _FIXED32
    FLOAT64 = _FIXED64


_DTYPE: dict[Kind, np.dtype[Any]] = {Kind.FLOAT32: np.dtype("<f4"), Kind.FLOAT64: np.dtype("<f8")}


def read_file(path: Path) -> memoryview:
    """The whole file; raises :class:`RaucaError` when it is missing, unreadable, or far larger than any such graph."""
    return memoryview(read_limited(path, MAX_FILE_BYTES, "a detector's weights"))


class Message:
    """The wanted fields of one message.

    Attributes:
        path: the file it came from; every error names it.
    """

    def __init__(self, path: Path, data: memoryview, schema: Mapping[int, Kind], limit: int = 2**20) -> None:
        """Read the fields that ``schema`` names by number, skip the others.

        Raises:
            RaucaError: data that ends inside a field, a field of another type, more than ``limit`` wanted fields.
        """
        self.path = path
        self._schema = schema
        self._found: dict[int, list[Any]] = {}
        count = 0
        for number, wire, value in _fields(path, data):
            if number in schema:
                count += 1
                if count > limit:
                    raise RaucaError(f"{path}: a message of more than {limit} fields; this is no graph of a detector")
                self._found.setdefault(number, []).append(self._checked(number, wire, value))

    def _checked(self, number: int, wire: int, value: int | memoryview) -> int | memoryview:
        kind = self._schema[number]
        if wire != kind and not (wire == _BYTES and kind is not Kind.BYTES):
            raise RaucaError(f"{self.path}: field {number} has wire type {wire}, expected {int(kind)}; damaged file")
        return value

    def __contains__(self, number: int) -> bool:
        return number in self._found

    def messages(self, number: int) -> list[memoryview]:
        """All values of a BYTES field."""
        return self._found.get(number, [])

    def text(self, number: int) -> str:
        """The last value of a BYTES field as UTF-8, "" when absent."""
        return self.texts(number)[-1] if number in self else ""

    def texts(self, number: int) -> list[str]:
        try:
            return [bytes(value).decode("utf-8") for value in self.messages(number)]
        except UnicodeDecodeError:
            raise RaucaError(
                f"{self.path}: field {number} is not text; the file is damaged or of another kind"
            ) from None

    def integers(self, number: int) -> list[int]:
        """All values of an INTEGER field, as signed 64-bit numbers."""
        values: list[int] = []
        for found in self._found.get(number, []):
            values += [found] if isinstance(found, int) else _packed(self.path, found)
        return [value - 2**64 if value >= 2**63 else value for value in values]

    def integer(self, number: int, default: int = 0) -> int:
        """The last value of an INTEGER field."""
        values = self.integers(number)
        return values[-1] if values else default

    def floats(self, number: int) -> NDArray[Any]:
        """All values of a FLOAT32 or FLOAT64 field; a view of the file when they are packed in one piece."""
        dtype = _DTYPE[self._schema[number]]
        pieces = self._found.get(number, [])
        if any(len(piece) % dtype.itemsize for piece in pieces):
            raise RaucaError(f"{self.path}: field {number} ends inside a number; damaged file")
        if len(pieces) == 1:
            return np.frombuffer(pieces[0], dtype)
        return np.frombuffer(b"".join(pieces), dtype)


def _fields(path: Path, data: memoryview) -> Iterator[tuple[int, int, int | memoryview]]:
    """(number, wire type, value) of every field."""
    position, end = 0, len(data)
    while position < end:
        key, position = _varint(path, data, position)
        number, wire = key >> 3, key & 7
        if wire == _VARINT:
            value, position = _varint(path, data, position)
            yield number, wire, value
            continue
        if wire == _BYTES:
            size, position = _varint(path, data, position)
        elif wire in _FIXED_SIZE:
            size = _FIXED_SIZE[wire]
        else:
            raise RaucaError(f"{path}: wire type {wire} is not protobuf as graphs use it; damaged, or another format")
        if number == 0 or size > end - position:
            raise RaucaError(f"{path}: a field claims {size} bytes where {end - position} are left; cut off or damaged")
        yield number, wire, data[position : position + size]
        position += size


def _varint(path: Path, data: memoryview, position: int) -> tuple[int, int]:
    result = shift = 0
    end = min(len(data), position + 10)  # 64 bits in groups of seven
    while position < end:
        byte = data[position]
        position += 1
        result |= (byte & 0x7F) << shift
        if byte < 0x80:
            return result & (2**64 - 1), position
        shift += 7
    raise RaucaError(f"{path}: a number has no end; the file is cut off or damaged")


def _packed(path: Path, data: memoryview) -> list[int]:
    values: list[int] = []
    position = 0
    while position < len(data):
        if len(values) == MAX_PACKED:
            raise RaucaError(f"{path}: more than {MAX_PACKED} integers in one field; this is no graph of a detector")
        value, position = _varint(path, data, position)
        values.append(value)
    return values
