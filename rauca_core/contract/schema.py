"""Strict JSON reading: every complaint names the file and the field.

>>> fields = Fields({"width": "wide"}, "frame.json")
>>> fields.integer("width", minimum=1)
Traceback (most recent call last):
rauca_core.contract.errors.RaucaError: frame.json: width must be a whole number, not 'wide'
"""

from __future__ import annotations

import math
import reprlib
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import RaucaError
from .reading import parse_json, read_text

MAX_JSON_BYTES = 64 * 2**20
"""The largest of ours, the results of a study of 10 000 frames in ten paints, are some 15 MiB."""
MAX_NAME = 128
"""Characters of a name that becomes a folder's: file systems take 255 bytes, a suffix or two of ours included."""


class Fields:
    """A JSON object under strict reading.

    Each getter returns a checked value or raises :class:`RaucaError`; :meth:`done` then refuses fields nobody asked
    for, so that a typo or a newer writer is noticed rather than ignored.
    """

    def __init__(self, data: Any, where: str) -> None:
        if not isinstance(data, dict):
            raise RaucaError(f"{where}: must be a JSON object, not {_shown(data)}")
        self._data = data
        self.where = where
        self._seen: set[str] = set()

    def _get(self, name: str) -> Any:
        self._seen.add(name)
        if name not in self._data:
            raise RaucaError(f"{self.where}: field {name} is missing")
        return self._data[name]

    def _refuse(self, name: str, wanted: str) -> RaucaError:
        return RaucaError(f"{self.where}: {name} must be {wanted}, not {_shown(self._data.get(name))}")

    def has(self, name: str) -> bool:
        """True when the field is there: for fields that may be left out."""
        return name in self._data

    def names(self) -> list[str]:
        """All fields, in the file's order: for an object that is a table of names."""
        return list(self._data)

    def without(self, name: str) -> dict[str, Any]:
        """A copy of the object that lacks one field."""
        return {key: value for key, value in self._data.items() if key != name}

    def is_null(self, name: str) -> bool:
        """True when the field is there and null."""
        return self._get(name) is None

    def raw(self, name: str) -> Any:
        """The value as it stands, for free-form remarks."""
        return self._get(name)

    def number(self, name: str, minimum: float = -math.inf, maximum: float = math.inf) -> float:
        """A finite number within [minimum, maximum]."""
        value = self._get(name)
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LARGEST_FLOAT:
            raise self._refuse(name, "a finite number")
        if not minimum <= value <= maximum:
            raise self._refuse(name, f"between {minimum:g} and {maximum:g}")
        return float(value)

    def integer(self, name: str, minimum: int = 0, maximum: int = 2**63) -> int:
        value = self._get(name)
        if isinstance(value, bool) or not isinstance(value, int):
            raise self._refuse(name, "a whole number")
        if not minimum <= value <= maximum:
            raise self._refuse(name, f"between {minimum} and {maximum}")
        return value

    def text(self, name: str) -> str:
        value = self._get(name)
        if not isinstance(value, str):
            raise self._refuse(name, "text")
        return value

    def flag(self, name: str) -> bool:
        value = self._get(name)
        if not isinstance(value, bool):
            raise self._refuse(name, "true or false")
        return value

    def file_name(self, name: str) -> str:
        """A relative path that stays inside its folder."""
        value = self.text(name)
        path = PurePosixPath(value)
        if not value or path.is_absolute() or ".." in path.parts or "\\" in value or ":" in value:
            raise self._refuse(name, "a relative path inside the folder")
        return value

    def plain_name(self, name: str) -> str:
        """Text that may name a folder or a file: no path, nothing hidden, nothing that a terminal or disk refuses."""
        value = self.text(name)
        if not is_plain_name(value):
            raise self._refuse(name, f"a name of 1 to {MAX_NAME} printable characters without / \\ : or a leading dot")
        return value

    def srgb(self, name: str) -> tuple[int, int, int]:
        """An 8-bit color: three whole numbers from 0 to 255."""
        value = self.array(name, (3,))
        if not ((value >= 0) & (value <= 255) & (value % 1 == 0)).all():
            raise self._refuse(name, "three whole numbers from 0 to 255")
        red, green, blue = (int(channel) for channel in value)
        return red, green, blue

    def array(self, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Nested lists of finite numbers of exactly ``shape``, as float64."""
        wanted = f"{'x'.join(map(str, shape))} finite numbers"
        try:
            value = np.array(self._get(name), dtype=np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise self._refuse(name, wanted) from error
        if value.shape != shape or not np.isfinite(value).all():
            raise self._refuse(name, wanted)
        return value

    def items(self, name: str) -> list[Any]:
        value = self._get(name)
        if not isinstance(value, list):
            raise self._refuse(name, "a list")
        return value

    def nested(self, name: str) -> Fields:
        return Fields(self._get(name), f"{self.where}: {name}")

    def format(self, name: str, version: int, oldest: int = 1) -> None:
        """Check the ``format`` and ``version`` fields that open every file of the contract."""
        found = self.text("format")
        if found != name:
            raise RaucaError(f"{self.where}: this is a {found} file, a {name} file was expected")
        written = self.integer("version", minimum=1)
        if written > version:
            raise RaucaError(
                f"{self.where}: written in {name} version {written}, this rauca reads up to {version}; update rauca"
            )
        if written < oldest:
            raise RaucaError(
                f"{self.where}: {name} version {written} is from an older rauca, this one reads from {oldest} on; "
                "make it again in another folder"
            )

    def done(self) -> None:
        unknown = sorted(set(self._data) - self._seen)
        if unknown:
            raise RaucaError(f"{self.where}: unknown field {', '.join(unknown)}")


def read_json(path: Path) -> Fields:
    """Open a JSON file for strict reading; raises :class:`RaucaError` when it is missing or not JSON."""
    path = Path(path)
    return Fields(parse_json(read_text(path, MAX_JSON_BYTES), str(path)), str(path))


def is_plain_name(value: str) -> bool:
    """Whether a text may name a folder or a file; see :meth:`Fields.plain_name`."""
    return 0 < len(value) <= MAX_NAME and value.isprintable() and value[0] != "." and not set(value) & set("/\\:")


def _shown(value: Any) -> str:
    text = _SHORT.repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


_LARGEST_FLOAT = float(np.finfo(np.float64).max)
_SHORT = reprlib.Repr()  # never writes out a list of millions to show its beginning
_SHORT.maxstring = _SHORT.maxlong = _SHORT.maxother = 80
