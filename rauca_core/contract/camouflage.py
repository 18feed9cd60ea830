"""A camouflage on disk: an 8-bit sRGB UV map (PNG) and the JSON that says which atlas it fits and how it was made."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from .errors import RaucaError
from .files import write_bytes, write_json
from .schema import Record, read_json

MAX_TEXELS = 8192
"""A side of the UV map: the largest image that is read (`reading.MAX_PIXELS`)."""


@dataclass(frozen=True)
class Camouflage(Record):
    """Metadata of a camouflage; the UV map lies beside it as ``<stem>.png``.

    Attributes:
        name: shown in tables.
        vehicle_name, atlas_id: the vehicle and UV layout that it fits.
        size: the UV map is square, texels.
        method: e.g. ``"rauca"``, ``"random"``, ``"plain"``.
        made: whatever the maker wants to remember (detector, steps, seed, losses).
    """

    FORMAT = ("rauca-camouflage", 1)
    name: Annotated[str, "plain_name"]
    vehicle_name: str
    atlas_id: str
    size: Annotated[int, (1, MAX_TEXELS)]
    method: str
    made: dict[str, Any] = field(default_factory=dict)

    def check_fits(self, atlas_id: str, where: str) -> None:
        """Raise :class:`RaucaError` when the camouflage was made for another UV layout."""
        if self.atlas_id != atlas_id:
            raise RaucaError(
                f"{where}: made for {self.vehicle_name} in another UV layout, and does not fit this vehicle; optimize "
                "one on this vehicle, or choose the vehicle that it was made for"
            )


def save_camouflage(path: Path, camouflage: Camouflage, png: bytes) -> None:
    """Write ``path`` (.json) and the UV map beside it (.png), the map first: a JSON always finds its map."""
    path = Path(path)
    write_bytes(path.with_suffix(".png"), png)
    write_json(path, camouflage.to_json())


def load_camouflage(path: Path) -> tuple[Camouflage, Path]:
    """Read a camouflage by its JSON or PNG path; returns the metadata and the path of the UV map."""
    path = Path(path).with_suffix(".json")
    camouflage = Camouflage.from_json(read_json(path))
    image = path.with_suffix(".png")
    if not image.is_file():
        raise RaucaError(f"{image}: the camouflage's UV map is missing; keep the .png beside the .json")
    return camouflage, image
