"""Strict JSON reading: every complaint names the file and the field.

>>> fields = Fields({"width": "wide"}, "frame.json")
>>> fields.integer("width", minimum=1)
Traceback (most recent call last):
rauca_core.contract.errors.RaucaError: frame.json: width must be a whole number, not 'wide'
"""

from __future__ import annotations

import json
import math
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import RaucaError

MAX_JSON_BYTES = 64 * 2**20


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
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
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

    def array(self, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
        """Nested lists of finite numbers of exactly ``shape``, as float64."""
        wanted = f"{'x'.join(map(str, shape))} finite numbers"
        try:
            value = np.array(self._get(name), dtype=np.float64)
        except (TypeError, ValueError) as error:
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
    try:
        if path.stat().st_size > MAX_JSON_BYTES:
            raise RaucaError(f"{path}: larger than {MAX_JSON_BYTES // 2**20} MiB, not a file of this project")
        return Fields(json.loads(path.read_text(encoding="utf-8")), str(path))
    except FileNotFoundError:
        raise RaucaError(f"{path}: not found") from None
    except (OSError, UnicodeDecodeError) as error:
        raise RaucaError(f"{path}: cannot be read ({error})") from error
    except (json.JSONDecodeError, RecursionError) as error:
        raise RaucaError(f"{path}: not valid JSON ({error})") from error


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
