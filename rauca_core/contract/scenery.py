"""Where a data set's vehicle stands: the project's town, or a scene of the user's."""

from __future__ import annotations

import hashlib
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .errors import RaucaError
from .schema import Fields


@dataclass(frozen=True)
class Scenery:
    """The surroundings of a data set.

    Attributes:
        kind: ``town`` (procedural, from the data set's seed) or ``blend`` (a user's file).
        name: the file's name; empty for the town.
        sha256: of the file's bytes, so that another scene is noticed; empty for the town.
    """

    kind: str = "town"
    name: str = ""
    sha256: str = ""

    @staticmethod
    def of_file(path: Path) -> Scenery:
        """Describe a ``.blend`` file; raises :class:`RaucaError` when it is missing or not one."""
        path = Path(path)
        if path.suffix.lower() != ".blend" or not path.is_file():
            raise RaucaError(f"{path}: no such scene; give a .blend file, or leave --scene out for the town")
        with path.open("rb") as stream:
            return Scenery("blend", path.name, hashlib.file_digest(stream, "sha256").hexdigest())

    def to_json(self) -> dict[str, Any]:
        return asdict(self)

    @staticmethod
    def from_json(fields: Fields) -> Scenery:
        scenery = Scenery(fields.text("kind"), fields.text("name"), fields.text("sha256"))
        fields.done()
        whole = re.fullmatch(r"[0-9a-f]{64}", scenery.sha256) is not None and bool(scenery.name)
        if not (scenery == Scenery() or (scenery.kind == "blend" and whole)):
            raise RaucaError(f"{fields.where}: must be the town, or a blend with its name and sha256")
        return scenery
