"""What an evaluation found, in memory and as ``results.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from ..contract import RaucaError
from ..contract.files import write_json
from ..contract.schema import Fields, read_json
from .detection_cache import DetectionSettings

FORMAT = ("rauca-results", 2)
MEAN = "mean"
T = TypeVar("T")
AXES = ("azimuth_deg", "elevation_deg", "distance_m", "sun_altitude_deg", "fog_density")


@dataclass(frozen=True)
class FrameRow:
    """A frame that took part, under its nominal camera (before jitter) and its weather.

    ``location`` and ``view`` are the data set's; version 1 did not keep them.
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
        mean: ``mean[paint]``, over detectors, with its interval; empty in results of version 1.
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
    table = {
        paint: {detector: _record(Estimate, row, f"{path}: table") for detector, row in _object(path, rows).items()}
        for paint, rows in _object(path, fields.raw("table")).items()
    }
    groups = {
        axis: tuple(_group(row, f"{path}: groups") for row in _list(path, rows))
        for axis, rows in _object(path, fields.raw("groups")).items()
    }
    images = {
        paint: tuple(_record(ImageRow, row, f"{path}: images") for row in _list(path, rows))
        for paint, rows in _object(path, fields.raw("images")).items()
    }
    results = Results(
        dataset=fields.text("dataset"),
        settings=_record(DetectionSettings, fields.raw("settings"), f"{path}: settings"),
        resamples=fields.integer("resamples", 1),
        seed=fields.integer("seed"),
        detectors={name: str(value) for name, value in _object(path, fields.raw("detectors")).items()},
        frames=tuple(_frame_row(Fields(row, f"{path}: frames[{i}]")) for i, row in enumerate(fields.items("frames"))),
        dropped=tuple(str(frame) for frame in fields.items("dropped")),
        table=table,
        groups=groups,
        images=images,
        **_since_version_2(fields),
    )
    fields.done()
    _check(path, results)
    return results


def _since_version_2(fields: Fields) -> dict[str, Any]:
    if not fields.has("clusters"):
        return {}
    texts = {name: fields.text(name) for name in ("vehicle", "defence", "clusters")}
    return {**texts, "cluster_count": fields.integer("cluster_count")}


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
    numbers |= {name: fields.integer(name) for name in ("location", "view") if fields.has(name)}
    row = FrameRow(fields.text("id"), fields.text("weather"), **numbers, box_xyxy=(left, top, right, bottom))
    fields.done()
    return row


def _group(value: Any, where: str) -> Group:
    group = _record(Group, value, where)
    if not isinstance(group.mean, dict):
        raise RaucaError(f"{where}: mean must be a JSON object; evaluate again")
    mean = {paint: _record(Estimate, row, where) for paint, row in group.mean.items()}
    return replace(group, mean=mean)


def _object(path: Path, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise RaucaError(f"{path}: expected a JSON object, found {str(value)[:40]}; evaluate again")
    return value


def _list(path: Path, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise RaucaError(f"{path}: expected a JSON list, found {str(value)[:40]}; evaluate again")
    return value


def _record(kind: type[T], value: Any, where: str) -> T:
    """A flat dataclass from a JSON object of exactly its fields."""
    try:
        return kind(**value)
    except TypeError as error:
        raise RaucaError(f"{where}: not a {kind.__name__} ({error}); evaluate again") from error
