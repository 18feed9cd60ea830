"""Strict JSON reading: every complaint names the file and the field.

A dataclass that derives from :class:`Record` is read and written field by field, as its annotations say; what has no
such class is read through the getters of :class:`Fields`.

>>> fields = Fields({"width": "wide"}, "frame.json")
>>> fields.integer("width", minimum=1)
Traceback (most recent call last):
rauca_core.contract.errors.RaucaError: frame.json: width must be a whole number, not 'wide'
"""

from __future__ import annotations

import contextlib
import functools
import math
import reprlib
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass
from dataclasses import fields as fields_of
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, ClassVar, Self, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from .errors import RaucaError
from .files import write_bytes
from .reading import parse_json, read_limited, read_text

MAX_JSON_BYTES = 64 * 2**20
"""The largest of ours, the results of a study of 10 000 frames in ten paints, are some 15 MiB."""
MAKE_AGAIN = "make it again in another folder"
MAX_NAME = 128
"""Characters of a name that becomes a folder's: file systems take 255 bytes, a suffix or two of ours included."""

_LARGEST_FLOAT = float(np.finfo(np.float64).max)
_SHORT = reprlib.Repr()  # never writes out a list of millions to show its beginning
_SHORT.maxstring = _SHORT.maxlong = _SHORT.maxother = 80

T = TypeVar("T")


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

    def texts(self, name: str) -> list[str]:
        value = self.items(name)
        if not all(isinstance(item, str) for item in value):
            raise self._refuse(name, "a list of texts")
        return value

    def nested(self, name: str) -> Fields:
        return Fields(self._get(name), f"{self.where}: {name}")

    def objects(self, name: str) -> list[Fields]:
        """A list of objects, to be read one by one."""
        return [Fields(item, f"{self.where}: {name}[{i}]") for i, item in enumerate(self.items(name))]

    def choice(self, name: str, words: Sequence[str]) -> str:
        """One of a few words."""
        value = self.text(name)
        if value not in words:
            raise self._refuse(name, f"one of {', '.join(words)}")
        return value

    def format(self, name: str, version: int, remedy: str = MAKE_AGAIN) -> None:
        """Check the ``format`` and ``version`` fields that open every file of the contract.

        Args:
            remedy: what helps where the file is older.
        """
        if "format" not in self._data:
            raise RaucaError(f"{self.where}: no {name} file, its field `format` is missing; give one that rauca wrote")
        found = self.text("format")
        if found != name:
            raise RaucaError(f"{self.where}: this is a {found} file, a {name} file was expected")
        written = self.integer("version", minimum=1)
        if written != version:
            remedy = "update rauca" if written > version else remedy
            raise RaucaError(f"{self.where}: written in {name} version {written}, this rauca reads {version}; {remedy}")

    def done(self) -> None:
        unknown = sorted(set(self._data) - self._seen)
        if unknown:
            raise RaucaError(f"{self.where}: unknown field {', '.join(unknown)}")


@dataclass(frozen=True, eq=False)
class Record:
    """A dataclass that is a JSON object on disk; fields that have a default may be left out there.

    Annotations are ``float``, ``int``, ``str``, ``Path``, ``bool``, arrays, records, tuples of numbers, texts, paths or
    records, dictionaries of any of these (free-form ones of ``Any``), and any of these or None. What more a value must
    be stands beside its type: ``Annotated[float, (0, 1)]`` limits a number, ``Annotated[NDArray, (3, 3)]`` tells the
    shape of an array, ``Annotated[str, ("town", "blend")]`` the words to choose from, and
    ``Annotated[str, "plain_name"]`` names the method of :class:`Fields` that reads it.
    """

    FORMAT: ClassVar[tuple[str, int] | None] = None
    """Name and version that open the file; None for an object inside another."""
    REMEDY: ClassVar[str] = MAKE_AGAIN
    """What helps against a file of an older version."""

    def to_json(self) -> dict[str, Any]:
        head = {} if self.FORMAT is None else {"format": self.FORMAT[0], "version": self.FORMAT[1]}
        return head | {known.name: _plain(getattr(self, known.name)) for known in fields_of(self)}

    @classmethod
    def from_json(cls, fields: Fields) -> Self:
        """Read one; raises :class:`RaucaError` naming the field that is missing, unknown or not what it must be."""
        if cls.FORMAT is not None:
            fields.format(*cls.FORMAT, cls.REMEDY)
        values = {}
        for known in fields_of(cls):
            if fields.has(known.name) or (known.default is MISSING and known.default_factory is MISSING):
                values[known.name] = _value(fields, known.name, _annotations(cls)[known.name])
        record = cls(**values)
        fields.done()
        record._check_whole(fields.where)
        return record

    def check(self, where: str) -> None:
        """Raise :class:`RaucaError` naming ``where`` and the field unless a reader would accept this record."""
        type(self).from_json(Fields(self.to_json(), where))

    def _check_whole(self, where: str) -> None:
        """Raise :class:`RaucaError` naming ``where`` for what no field can tell alone."""


Rgb8 = Annotated[tuple[int, int, int], "srgb"]
_annotations: Callable[[type], dict[str, Any]] = functools.cache(functools.partial(get_type_hints, include_extras=True))


def _plain(value: Any) -> Any:
    """A field of a record as JSON holds it."""
    if isinstance(value, Record):
        return value.to_json()
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, Path):
        return str(value)
    return value.tolist() if isinstance(value, np.ndarray) else value


def _value(fields: Fields, name: str, kind: Any) -> Any:
    """A field of a record, as its annotation says."""
    mark: Any = ()
    if get_origin(kind) is Annotated:
        kind, mark = get_args(kind)
    parts = get_args(kind)
    if isinstance(mark, str):
        return getattr(fields, mark)(name)
    if type(None) in parts:
        return None if fields.is_null(name) else _value(fields, name, parts[0])
    if isinstance(kind, type) and issubclass(kind, Record):
        return kind.from_json(fields.nested(name))
    if get_origin(kind) is tuple:
        return _tuple(fields, name, parts)
    if get_origin(kind) is dict:
        inner = fields.nested(name)
        return fields.raw(name) if parts[1] is Any else {key: _value(inner, key, parts[1]) for key in inner.names()}
    if kind is Path:
        return Path(fields.text(name))
    if kind is str:
        return fields.choice(name, mark) if mark else fields.text(name)
    simple: dict[Any, Callable[..., Any]] = {float: fields.number, int: fields.integer, bool: fields.flag}
    return simple[kind](name, *mark) if kind in simple else fields.array(name, mark)


def _tuple(fields: Fields, name: str, parts: tuple[Any, ...]) -> tuple[Any, ...]:
    """Texts, paths, numbers or records: as many as the annotation has, or any number."""
    if parts[0] in (str, Path):
        return tuple(parts[0](text) for text in fields.texts(name))
    if issubclass(parts[0], Record):
        return tuple(parts[0].from_json(item) for item in fields.objects(name))
    count = len(fields.items(name)) if Ellipsis in parts else len(parts)
    return tuple(fields.array(name, (count,)).tolist())


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


def whole_lines(path: Path, limit: int, kind: str, read: Callable[[Fields], T], mend: bool = False) -> list[T]:
    """What ``read`` makes of every whole line, in the file's order.

    Passed over are lines that are no JSON object and those to which ``read`` raises :class:`RaucaError`.

    Args:
        limit, kind: as of :func:`~.reading.read_limited`.
        mend: write the file anew without the lines that were passed over.

    Raises:
        RaucaError: the file itself cannot be read.
    """
    lines = read_limited(path, limit, kind).splitlines()
    whole, found = [], []
    for line in lines:
        with contextlib.suppress(RaucaError):
            found.append(read(Fields(parse_json(line, path.name), path.name)))
            whole.append(line)
    if mend and whole != lines:
        write_bytes(path, b"".join(line + b"\n" for line in whole))
    return found
