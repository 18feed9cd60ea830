"""What an evaluation found, in memory and as ``results.json``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from ..contract import RaucaError
from ..contract.files import write_json
from ..contract.schema import Fields, read_json
from .detection_cache import DetectionSettings

FORMAT = ("rauca-results", 3)
MEAN = "mean"
T = TypeVar("T")
AXES = ("azimuth_deg", "elevation_deg", "distance_m", "sun_altitude_deg", "fog_density")


@dataclass(frozen=True)
class FrameRow:
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
class Estimate:
    """AP@0.5 in [0, 1] over frames, and the bootstrap's 95 % interval over their locations (see `bootstrap.py`)."""

    ap: float
    low: float
    high: float


@dataclass(frozen=True)
class Group:
    """AP@0.5 of the frames that share a value on one of :data:`AXES`.

    Attributes:
        value: on the axis.
        frames: how many share it.
        ap: ``ap[paint][detector]``.
        mean: ``mean[paint]``, over detectors, with its interval.
    """

    value: float
    frames: int
    ap: dict[str, dict[str, float]]
    mean: dict[str, Estimate] = field(default_factory=dict)


@dataclass(frozen=True)
class ImageRow:
    """An image that was evaluated; ``path`` is relative to the results' folder."""

    path: str
    sha256: str


@dataclass(frozen=True)
class Results:
    """An evaluation.

    Attributes:
        dataset: the data set's name.
        settings: of detection; ``settings.category`` is the target's class.
        resamples, seed: of the bootstrap.
        detectors: name -> fingerprint, in table order.
        frames: that took part, in plan order.
        dropped: ids of frames that show too little of the vehicle to have a box.
        table: ``table[paint][detector or "mean"]``.
        groups: ``groups[axis]``, sorted by value.
        images: ``images[paint]``, in the order of ``frames``; under a defence, as it left them.
        detections: ``detections[paint][detector]``, the folder that keeps them, relative to the results' folder.
        vehicle: the data set's vehicle.
        defence: what the images went through before detection.
        clusters, cluster_count: what the bootstrap draws (``locations``, ``views`` or ``frames``), and how many.
    """

    dataset: str
    settings: DetectionSettings
    resamples: int
    seed: int
    detectors: dict[str, str]
    frames: tuple[FrameRow, ...]
    dropped: tuple[str, ...]
    table: dict[str, dict[str, Estimate]]
    groups: dict[str, tuple[Group, ...]]
    images: dict[str, tuple[ImageRow, ...]]
    detections: dict[str, dict[str, str]] = field(default_factory=dict)
    vehicle: str = ""
    defence: str = "none"
    clusters: str = "frames"
    cluster_count: int = 0

    @property
    def paints(self) -> tuple[str, ...]:
        return tuple(self.table)


def save_results(path: Path, results: Results) -> None:
    """Write ``results.json`` atomically."""
    name, version = FORMAT
    write_json(path, {"format": name, "version": version, **asdict(results)})


def load_results(path: Path) -> Results:
    """Read ``results.json``; raises :class:`RaucaError` when it is missing, damaged or from a newer rauca."""
    fields = read_json(path)
    fields.format(*FORMAT)
    detectors = fields.nested("detectors")
    table = {paint: _estimates(row) for paint, row in _each(fields.nested("table")).items()}
    results = Results(
        dataset=fields.text("dataset"),
        settings=_settings(fields.nested("settings")),
        resamples=fields.integer("resamples", 1),
        seed=fields.integer("seed"),
        detectors={name: detectors.text(name) for name in detectors.names()},
        frames=_rows(fields, "frames", _frame_row),
        dropped=tuple(str(frame) for frame in fields.items("dropped")),
        table=table,
        groups=_rows_by_name(fields.nested("groups"), _group),
        images=_rows_by_name(fields.nested("images"), _image_row),
        detections={
            paint: {name: row.text(name) for name in row.names()}
            for paint, row in _each(fields.nested("detections")).items()
        },
        vehicle=fields.text("vehicle"),
        defence=fields.text("defence"),
        clusters=fields.text("clusters"),
        cluster_count=fields.integer("cluster_count"),
    )
    fields.done()
    _check(path, results)
    return results


def _check(path: Path, results: Results) -> None:
    columns = {*results.detectors, MEAN}
    if not results.table or any(set(row) != columns for row in results.table.values()):
        raise RaucaError(f"{path}: table and detectors do not fit together; evaluate again")
    if set(results.images) != set(results.table) or any(len(i) != len(results.frames) for i in results.images.values()):
        raise RaucaError(f"{path}: images and frames do not fit together; evaluate again")
    if set(results.groups) != set(AXES):
        raise RaucaError(f"{path}: groups must be {', '.join(AXES)}; evaluate again")


def _frame_row(fields: Fields) -> FrameRow:
    left, top, right, bottom = fields.array("box_xyxy", (4,)).tolist()
    numbers: dict[str, Any] = {name: fields.number(name) for name in AXES}
    numbers |= {name: fields.integer(name) for name in ("location", "view")}
    row = FrameRow(fields.text("id"), fields.text("weather"), **numbers, box_xyxy=(left, top, right, bottom))
    fields.done()
    return row


def _settings(fields: Fields) -> DetectionSettings:
    thresholds = (fields.number(name) for name in ("score_threshold", "other_threshold", "iou_threshold"))
    settings = DetectionSettings(fields.text("category"), *thresholds)
    fields.done()
    return settings


def _image_row(fields: Fields) -> ImageRow:
    row = ImageRow(fields.text("path"), fields.text("sha256"))
    fields.done()
    return row


def _group(fields: Fields) -> Group:
    ap = {paint: {name: row.number(name) for name in row.names()} for paint, row in _each(fields.nested("ap")).items()}
    group = Group(fields.number("value"), fields.integer("frames"), ap, _estimates(fields.nested("mean")))
    fields.done()
    return group


def _estimates(table: Fields) -> dict[str, Estimate]:
    """Estimates by name."""
    return {name: _estimate(row) for name, row in _each(table).items()}


def _estimate(fields: Fields) -> Estimate:
    estimate = Estimate(*map(fields.number, ("ap", "low", "high")))
    fields.done()
    return estimate


def _each(table: Fields) -> dict[str, Fields]:
    """The objects of a table, by name."""
    return {name: table.nested(name) for name in table.names()}


def _rows(table: Fields, name: str, read: Callable[[Fields], T]) -> tuple[T, ...]:
    """A list of objects, each read by ``read``."""
    return tuple(read(Fields(row, f"{table.where}: {name}[{i}]")) for i, row in enumerate(table.items(name)))


def _rows_by_name(table: Fields, read: Callable[[Fields], T]) -> dict[str, tuple[T, ...]]:
    return {name: _rows(table, name, read) for name in table.names()}
