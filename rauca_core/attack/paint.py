"""A camouflage in memory: the UV map as an array, and the record of what it fits and how it was made."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contract import Camouflage, load_camouflage, save_camouflage
from ..contract.files import png_bytes
from ..runtime.images import read_image


@dataclass(frozen=True, eq=False)
class Paint:
    """A finished camouflage.

    Attributes:
        record: which vehicle and UV layout it fits, and how it was made.
        texture: (size, size, 3) uint8 sRGB, the UV map, row 0 at the top, gutters filled.
        path: of its JSON file; None while it is in memory alone.
        history: of every step that made it, as in ``history.jsonl``; empty where that is not known.
    """

    record: Camouflage
    texture: NDArray[np.uint8]
    path: Path | None = None
    history: list[dict[str, float]] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.record.name

    def save(self, path: Path | str) -> Path:
        """Write the JSON to ``path`` and the UV map beside it as PNG; returns the JSON's path."""
        path = Path(path).with_suffix(".json")
        save_camouflage(path, self.record, png_bytes(self.texture))
        return path


def load_paint(path: Path | str) -> Paint:
    """Read a camouflage by the path of its JSON or PNG.

    Raises:
        RaucaError: one of the two files is missing or damaged.
    """
    record, image = load_camouflage(Path(path))
    return Paint(record, read_image(image), image.with_suffix(".json"))
