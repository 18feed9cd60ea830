"""Artifacts: whatever a study needs, named by all that its bytes depend on.

The name's digest is over the recipe: canonical JSON of the kind and its format's version, the settings, and the digests
of the inputs. So a changed vehicle or another learning rate is another artifact, and nothing is taken for something
else. What only says how to make it (a number of threads, where a file lies, which part is wanted first) is left out.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from ..contract import RaucaError
from ..contract.files import write_json
from ..contract.schema import Fields, read_json

RECIPE = "recipe.json"
FORMAT = ("rauca-artifact", 1)
VERSIONS = {
    "vehicle": 1, "views": 1, "part": 1, "extractor": 1, "paint": 1, "random": 1, "map": 1, "renders": 1,
    "defended": 1, "detections": 1, "hardened": 3, "interpolated": 1, "ranking": 1,
    "composed": 1, "vacant": 1,
}  # fmt: skip
"""Of each kind's format: a higher number makes all of a kind anew, after a change of the code that makes it. A ``map``
is a finished camouflage's UV map, which is always given."""
_DIGITS = 12
_LONGEST_LABEL = 80


@dataclass(frozen=True)
class Artifact:
    """Something that was made, or is to be.

    Attributes:
        kind: one of :data:`VERSIONS`.
        label: for people; letters, digits, dots and dashes.
        settings: JSON, all that it depends on beside its inputs.
        inputs: other artifacts that it is made from.
        options: JSON, what its maker needs to know and its bytes do not depend on.
        place: where it lies, if it was given and is not to be made.
        known: the digest, of one that was read back: its inputs do not tell theirs.
    """

    kind: str
    label: str
    settings: Mapping[str, Any]
    inputs: tuple[Artifact, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    place: Path | None = None
    known: str = ""

    @cached_property
    def digest(self) -> str:
        """Hexadecimal, the same on every machine."""
        if self.known:
            return self.known
        inputs = [artifact.digest for artifact in self.inputs]
        return digest_of([self.kind, VERSIONS[self.kind], dict(self.settings), inputs])

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{plain_label(self.label)}-{self.digest}"

    def write_recipe(self, folder: Path, inputs: tuple[Path, ...], seconds: float = 0.0) -> None:
        """Note in its folder what it is, so that any process can make it and a reader knows it.

        Args:
            inputs: the folders of its inputs.
            seconds: that were spent on it so far.
        """
        name, version = FORMAT
        rows = [
            {**one._fields(), "folder": Path(os.path.relpath(place.absolute(), folder.absolute())).as_posix()}
            for one, place in zip(self.inputs, inputs, strict=True)
        ]
        opening = {"format": name, "version": version}
        recipe = {**opening, **self._fields(), "options": dict(self.options), "inputs": rows, "seconds": seconds}
        write_json(folder / RECIPE, recipe)

    def _fields(self) -> dict[str, Any]:
        return {"kind": self.kind, "label": self.label, "digest": self.digest, "settings": dict(self.settings)}


def read_recipe(folder: Path) -> tuple[Artifact, float]:
    """The artifact that a folder holds or is to hold, its inputs as given ones, and the seconds spent on it.

    Raises:
        RaucaError: the recipe is missing, damaged, or of a newer rauca.
    """
    fields = read_json(Path(folder) / RECIPE)
    fields.format(*FORMAT)
    rows = [Fields(row, f"{fields.where}: inputs[{i}]") for i, row in enumerate(fields.items("inputs"))]
    inputs = tuple(_read(row, Path(folder) / row.text("folder")) for row in rows)
    artifact = _read(fields, None, inputs, fields.raw("options"))
    seconds = fields.number("seconds", 0)
    fields.done()
    return artifact, seconds


def _read(
    fields: Fields, place: Path | None, inputs: tuple[Artifact, ...] = (), options: Mapping[str, Any] | None = None
) -> Artifact:
    kind = fields.text("kind")
    if kind not in VERSIONS:
        raise RaucaError(f"{fields.where}: holds {kind!r}, which this rauca does not know; update rauca")
    label, settings, known = fields.text("label"), fields.raw("settings"), fields.text("digest")
    return Artifact(kind, label, settings, inputs, options or {}, place, known)


def seconds_spent(folder: Path) -> float:
    """That were spent on an artifact so far; 0 if nobody knows."""
    with contextlib.suppress(RaucaError):
        return read_recipe(folder)[1]
    return 0.0


def digest_of(value: Any) -> str:
    """Names a JSON value; the order of fields does not matter."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def plain_label(text: str) -> str:
    """A text as a part of a folder's name."""
    return re.sub(r"[^A-Za-z0-9._+-]+", "-", text).strip("-.")[:_LONGEST_LABEL] or "x"
