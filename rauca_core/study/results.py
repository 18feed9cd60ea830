"""What an evaluation found, in memory and as ``results.json``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..contract import RaucaError
from ..contract.files import write_json
from ..contract.schema import Record, read_json
from .detection_cache import DetectionSettings

AXES = ("azimuth_deg", "elevation_deg", "distance_m", "sun_altitude_deg", "fog_density")


@dataclass(frozen=True)
class FrameRow(Record):
    """A frame that took part, under its nominal camera (before jitter) and its weather.

    ``location`` and ``view`` are the data set's.
    """

    id: str
    weather: str
    azimuth_deg: float
    elevation_deg: float
    distance_m: float
    sun_altitude_deg: float
    fog_density: float
    box_xyxy: tuple[float, float, float, float]
    location: int = 0
    view: int = 0


@dataclass(frozen=True)
class Estimate(Record):
    """AP@0.5 in [0, 1] over frames, and its 95 % interval over their places (see `intervals.py`)."""

    ap: float
    low: float
    high: float


@dataclass(frozen=True)
class Group(Record):
    """AP@0.5 of the frames that share a value on one of :data:`AXES`.

    Attributes:
        value: on the axis.
        frames: how many share it.
        ap: ``ap[paint][detector]``.
    """

    value: float
    frames: int
    ap: dict[str, dict[str, float]]


@dataclass(frozen=True)
class ImageRow(Record):
    """An image that was evaluated; ``path`` is relative to the results' folder."""

    path: str
    sha256: str


@dataclass(frozen=True)
class Results(Record):
    """An evaluation.

    Attributes:
        dataset: the data set's name.
        settings: of detection; ``settings.category`` is the target's class.
        detectors: name -> fingerprint, in table order.
        frames: that took part, in plan order.
        dropped: ids of frames that show too little of the vehicle to have a box.
        table: ``table[paint][detector]``.
        groups: ``groups[axis]``, sorted by value.
        images: ``images[paint]``, in the order of ``frames``; under a defence, as it left them.
        detections: ``detections[paint][detector]``, the folder that keeps them, relative to the results' folder.
        vehicle: the data set's vehicle.
        defence: what the images went through before detection.
        composed: the images show pictures from elsewhere, in camouflages by their light maps; never to be averaged with
            rendered ones.
        place_kind, place_count: what intervals are over (``locations``, ``views`` or ``frames``), and how many.
    """

    FORMAT = ("rauca-results", 5)
    REMEDY = "run the command that made it again, in the same folder: what was rendered and detected is kept"

    dataset: str
    settings: DetectionSettings
    detectors: dict[str, str]
    frames: tuple[FrameRow, ...]
    dropped: tuple[str, ...]
    table: dict[str, dict[str, Estimate]]
    groups: dict[str, tuple[Group, ...]]
    images: dict[str, tuple[ImageRow, ...]]
    detections: dict[str, dict[str, str]] = field(default_factory=dict)
    vehicle: str = ""
    defence: str = "none"
    place_kind: str = "frames"
    place_count: int = 0
    composed: bool = False

    def to_json(self) -> dict[str, Any]:
        """As of any record; results of renders say nothing of ``composed``, and stay what older versions read."""
        told = super().to_json()
        return told if self.composed else {name: value for name, value in told.items() if name != "composed"}

    @property
    def places(self) -> str:
        """What intervals are over, such as ``8 locations``."""
        return f"{self.place_count} {self.place_kind}"

    @property
    def paints(self) -> tuple[str, ...]:
        return tuple(self.table)

    def _check_whole(self, where: str) -> None:
        if not self.table or any(set(row) != set(self.detectors) for row in self.table.values()):
            raise RaucaError(f"{where}: table and detectors do not fit together; evaluate again")
        if set(self.images) != set(self.table) or any(len(i) != len(self.frames) for i in self.images.values()):
            raise RaucaError(f"{where}: images and frames do not fit together; evaluate again")
        if set(self.groups) != set(AXES):
            raise RaucaError(f"{where}: groups must be {', '.join(AXES)}; evaluate again")


def save_results(path: Path, results: Results) -> None:
    """Write ``results.json`` atomically."""
    write_json(path, results.to_json())


def load_results(path: Path) -> Results:
    """Read ``results.json``; raises :class:`RaucaError` when it is missing, damaged or of another version."""
    return Results.from_json(read_json(path))
