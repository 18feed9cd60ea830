"""A data set on disk: a vehicle, a plan, and the frames rendered so far.

Folder layout::

    dataset.json       the plan: everything needed to render any frame again
    vehicle/           see `vehicle.py`
    frames/<id>/       see `frame.py`
    ledger.jsonl       one line per frame, appended after the frame's rename
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from .errors import RaucaError
from .files import write_json
from .frame import Frame, load_frame
from .quality import Quality
from .scenery import Scenery
from .schema import Fields, read_json
from .weather import Weather

FORMAT = ("rauca-dataset", 2)
TOWN = Scenery()
FINISHES = ("own", "car_paint", "sticker")
MAX_FRAMES = 1_000_000
"""Of one plan: a year of rendering, and some 200 MiB as a list of frames. Every command begins by making that list."""


@dataclass(frozen=True)
class Ring:
    """Where the cameras stand around the vehicle.

    Every combination of azimuth, elevation and distance is one view; jitter is drawn per view and location, uniformly
    within +- the given amount.

    Attributes:
        azimuths_deg: 0 faces the vehicle's front, counter-clockwise from above.
        elevations_deg, distances_m: of the camera, from the vehicle's center.
        jitter_azimuth_deg, jitter_elevation_deg, jitter_roll_deg: half-widths, degrees.
        jitter_distance: half-width as a fraction of the distance.
        jitter_aim_m: half-width of the shift of the point looked at, metres.
        fov_deg: horizontal field of view.
    """

    azimuths_deg: tuple[float, ...]
    elevations_deg: tuple[float, ...]
    distances_m: tuple[float, ...]
    jitter_azimuth_deg: float = 0.0
    jitter_elevation_deg: float = 0.0
    jitter_distance: float = 0.0
    jitter_aim_m: float = 0.0
    jitter_roll_deg: float = 0.0
    fov_deg: float = 60.0

    def __len__(self) -> int:
        return len(self.azimuths_deg) * len(self.elevations_deg) * len(self.distances_m)

    def nominal(self, view: int) -> tuple[float, float, float]:
        """Azimuth, elevation (degrees) and distance (metres) of a view before jitter."""
        per_elevation = len(self.azimuths_deg) * len(self.elevations_deg)
        return (
            self.azimuths_deg[view % len(self.azimuths_deg)],
            self.elevations_deg[view // len(self.azimuths_deg) % len(self.elevations_deg)],
            self.distances_m[view // per_elevation],
        )

    def to_json(self) -> dict[str, Any]:
        return {k: list(v) if isinstance(v, tuple) else v for k, v in self.__dict__.items()}

    @staticmethod
    def from_json(fields: Fields) -> Ring:
        def floats(name: str) -> tuple[float, ...]:
            return tuple(fields.array(name, (len(_filled(fields, name)),)).tolist())

        ring = Ring(
            floats("azimuths_deg"),
            floats("elevations_deg"),
            floats("distances_m"),
            fields.number("jitter_azimuth_deg", 0, 180),
            fields.number("jitter_elevation_deg", 0, 90),
            fields.number("jitter_distance", 0, 0.9),
            fields.number("jitter_aim_m", 0, 100),
            fields.number("jitter_roll_deg", 0, 180),
            fields.number("fov_deg", 1, 170),
        )
        fields.done()
        if min(ring.distances_m) <= 0:
            raise RaucaError(f"{fields.where}: distances_m must be above 0, not {min(ring.distances_m):g}")
        return ring


@dataclass(frozen=True)
class Plan:
    """What a data set consists of, before anything is rendered.

    Attributes:
        name: for people.
        vehicle_name, atlas_id: which vehicle, and which UV layout, the frames show.
        size: frames are square, pixels.
        quality: how well they are rendered.
        light: True renders the affine light maps A and B (to optimize on); False renders the reference paint itself
            and leaves A and B out (to evaluate on).
        weathers, ring, locations: every combination is one frame.
        reference_srgb: 8-bit sRGB paint color of ``image.png``.
        min_visible: frames that see less of the paint than this fraction are kept out.
        seed: names every random stream of the data set.
        blender: version that renders it.
        scenery: where the vehicle stands.
        finish: of the paint: the vehicle's ``own``, ``car_paint`` (clearcoat) or ``sticker`` (matte).
        recolor_share: share of frames rendered once more for real in another color, to check the light maps.
    """

    name: str
    vehicle_name: str
    atlas_id: str
    size: int
    quality: Quality
    light: bool
    weathers: tuple[Weather, ...]
    ring: Ring
    locations: int
    reference_srgb: tuple[int, int, int]
    min_visible: float
    seed: int
    blender: str
    scenery: Scenery = TOWN
    finish: str = "own"
    recolor_share: float = 0.0

    def frame_ids(self) -> list[tuple[str, int, int, Weather]]:
        """Every planned frame as (id, location, view, weather), in rendering order."""
        return [
            (f"L{location:02d}-V{view:03d}-{weather.name}", location, view, weather)
            for location in range(self.locations)
            for weather in self.weathers
            for view in range(len(self.ring))
        ]

    def to_json(self) -> dict[str, Any]:
        name, version = FORMAT
        return {
            "format": name,
            "version": version,
            "name": self.name,
            "vehicle_name": self.vehicle_name,
            "atlas_id": self.atlas_id,
            "size": self.size,
            "quality": self.quality.to_json(),
            "light": self.light,
            "weathers": [w.to_json() for w in self.weathers],
            "ring": self.ring.to_json(),
            "locations": self.locations,
            "scenery": self.scenery.to_json(),
            "finish": self.finish,
            "reference_srgb": list(self.reference_srgb),
            "min_visible": self.min_visible,
            "recolor_share": self.recolor_share,
            "seed": self.seed,
            "blender": self.blender,
        }

    def check(self, where: str) -> None:
        """Raise :class:`RaucaError` naming ``where`` and the field when a value is out of range."""
        Plan.from_json(Fields(self.to_json(), where))

    @staticmethod
    def from_json(fields: Fields) -> Plan:
        fields.format(*FORMAT, oldest=2)
        weathers = [
            Weather.from_json(Fields(w, f"{fields.where}: weathers[{i}]"))
            for i, w in enumerate(_filled(fields, "weathers"))
        ]
        plan = Plan(
            fields.text("name"),
            fields.text("vehicle_name"),
            fields.text("atlas_id"),
            fields.integer("size", 16, 8192),
            Quality.from_json(fields.nested("quality")),
            fields.flag("light"),
            tuple(weathers),
            Ring.from_json(fields.nested("ring")),
            fields.integer("locations", 1, 10000),
            fields.srgb("reference_srgb"),
            fields.number("min_visible", 0, 1),
            fields.integer("seed"),
            fields.text("blender"),
            Scenery.from_json(fields.nested("scenery")),
            fields.text("finish"),
            fields.number("recolor_share", 0, 1),
        )
        fields.done()
        if plan.finish not in FINISHES:
            raise RaucaError(f"{fields.where}: finish must be one of {', '.join(FINISHES)}, not {plan.finish!r}")
        planned = plan.locations * len(plan.weathers) * len(plan.ring)
        if planned > MAX_FRAMES:
            raise RaucaError(f"{fields.where}: plans {planned} frames; at most {MAX_FRAMES} are made in one data set")
        return plan


def _filled(fields: Fields, name: str) -> list[Any]:
    items = fields.items(name)
    if not items:
        raise RaucaError(f"{fields.where}: {name} must not be empty")
    return items


class Dataset:
    """A data set folder opened for reading: its plan and its finished frames."""

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self.plan = read_plan(self.folder)

    @property
    def vehicle_folder(self) -> Path:
        return self.folder / "vehicle"

    def frame_folder(self, frame_id: str) -> Path:
        return frame_folder(self.folder, frame_id)

    def frames(self) -> list[Frame]:
        """Finished frames in plan order; frames kept out as occluded have no folder and do not appear."""
        there = self.begun()
        planned = (self.frame_folder(frame_id) for frame_id, *_ in self.plan.frame_ids() if frame_id in there)
        return [load_frame(folder) for folder in planned if (folder / "frame.json").is_file()]

    def begun(self) -> frozenset[str]:
        """Names of all there is among the frames: one look, where a plan may have thousands that are not rendered."""
        frames = self.folder / "frames"
        return frozenset(os.listdir(frames)) if frames.is_dir() else frozenset()


def frame_folder(dataset: Path, frame_id: str) -> Path:
    return Path(dataset) / "frames" / frame_id


def read_plan(folder: Path) -> Plan:
    """Read ``dataset.json``; raises :class:`RaucaError` when it is missing, damaged or from a newer rauca."""
    path = Path(folder) / "dataset.json"
    if not path.is_file():
        raise RaucaError(f"{folder}: not a data set (no dataset.json); make one with `rauca dataset make`")
    return Plan.from_json(read_json(path))


def claim_folder(folder: Path, plan: Plan) -> None:
    """Write the plan into an empty folder, or accept a folder that already holds the same plan.

    A different plan is refused rather than mixed in; only the Blender version and the name may differ (folders are
    moved and renamed), and are kept as first written.
    """
    path = Path(folder) / "dataset.json"
    if path.is_file():
        found = read_plan(folder)
        plan = replace(plan, blender=found.blender, name=found.name)
        if found != plan:
            changed = [k for k, v in plan.to_json().items() if found.to_json()[k] != v]
            raise RaucaError(
                f"{folder}: holds a data set made with another {', '.join(changed)}; choose another folder or remove it"
            )
        return
    write_json(path, plan.to_json())
