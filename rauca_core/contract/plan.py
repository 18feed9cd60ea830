"""What a data set consists of before anything is rendered: ``dataset.json``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from .clips import Clips
from .errors import RaucaError
from .files import file_digest, write_json
from .schema import Record, Rgb8, read_json
from .weather import Weather


@dataclass(frozen=True)
class Quality(Record):
    """Settings of the path tracer; `rauca bench dataset` measures what each costs and gives.

    Attributes:
        samples: paths per pixel of each render, before denoising; the most a pixel gets if sampling is adaptive.
        adaptive_threshold: noise at which a pixel stops being sampled; 0 gives every pixel all samples.
        denoise: use Open Image Denoise.
        bounces: of light between surfaces.
        composed_fog: compose fog around the vehicle from the clear render, where that is accurate.
    """

    samples: Annotated[int, (1, 65536)] = 8
    adaptive_threshold: Annotated[float, (0, 1)] = 0.0
    denoise: bool = True
    bounces: Annotated[int, (0, 64)] = 4
    composed_fog: bool = True


@dataclass(frozen=True)
class Scenery(Record):
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
        return Scenery("blend", path.name, file_digest(path))

    def _check_whole(self, where: str) -> None:
        whole = re.fullmatch(r"[0-9a-f]{64}", self.sha256) is not None and bool(self.name)
        if not (self == Scenery() or (self.kind == "blend" and whole)):
            raise RaucaError(f"{where}: must be the town, or a blend with its name and sha256")


CPU = "cpu"
REFERENCE_SRGB = (140, 140, 140)
MIN_VISIBLE = 0.5
FINISHES = ("own", "car_paint", "sticker")
MAX_FRAMES = 1_000_000
"""Of one plan: a year of rendering, and some 200 MiB as a list of frames. Every command begins by making that list."""


@dataclass(frozen=True)
class Ring(Record):
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
    jitter_azimuth_deg: Annotated[float, (0, 180)] = 0.0
    jitter_elevation_deg: Annotated[float, (0, 90)] = 0.0
    jitter_distance: Annotated[float, (0, 0.9)] = 0.0
    jitter_aim_m: Annotated[float, (0, 100)] = 0.0
    jitter_roll_deg: Annotated[float, (0, 180)] = 0.0
    fov_deg: Annotated[float, (1, 170)] = 60.0

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

    def _check_whole(self, where: str) -> None:
        for name in ("azimuths_deg", "elevations_deg", "distances_m"):
            if not getattr(self, name):
                raise RaucaError(f"{where}: {name} must not be empty")
        if min(self.distances_m) <= 0:
            raise RaucaError(f"{where}: distances_m must be above 0, not {min(self.distances_m):g}")


class PlannedFrame(NamedTuple):
    """One frame before it is rendered."""

    id: str
    location: int
    view: int
    weather: Weather

    @property
    def camera(self) -> tuple[int, int]:
        """Location and view."""
        return self.location, self.view

    @property
    def place_and_weather(self) -> tuple[int, str]:
        """As of a frame: location and the weather's name."""
        return self.location, self.weather.name


@dataclass(frozen=True)
class Plan(Record):
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
        device: that renders it: ``cpu``, or a backend of Cycles with its GPUs, such as ``OPTIX: NVIDIA L4``.
        clips: what is driven instead of the ring's views, of which only ``fov_deg`` counts then; None: still views.
    """

    FORMAT = ("rauca-dataset", 3)
    name: str
    vehicle_name: str
    atlas_id: str
    size: Annotated[int, (16, 8192)]
    quality: Quality
    light: bool
    weathers: tuple[Weather, ...]
    ring: Ring
    locations: Annotated[int, (1, 10000)]
    reference_srgb: Rgb8
    min_visible: Annotated[float, (0, 1)]
    seed: int
    blender: str
    scenery: Scenery = Scenery()
    finish: Annotated[str, FINISHES] = "own"
    recolor_share: Annotated[float, (0, 1)] = 0.0
    device: str = CPU
    clips: Clips | None = None

    def to_json(self) -> dict[str, Any]:
        """As of any record; still views say nothing of clips, and stay what older versions read."""
        told = super().to_json()
        return told if self.clips else {name: value for name, value in told.items() if name != "clips"}

    @property
    def views(self) -> int:
        """Of each location: the ring's, or the frames of its clips."""
        return len(self.ring) if self.clips is None else len(self.clips)

    @staticmethod
    def of(weathers: Sequence[Weather], ring: Ring, **chosen: Any) -> Plan:
        """A plan before Blender has filled in what only it knows; what is not ``chosen`` is as usual."""
        usual: dict[str, Any] = {
            "name": "", "vehicle_name": "", "atlas_id": "", "size": 320, "quality": Quality(), "light": True,
            "locations": 1, "reference_srgb": REFERENCE_SRGB, "min_visible": MIN_VISIBLE, "seed": 0, "blender": "",
        }  # fmt: skip
        return Plan(weathers=tuple(weathers), ring=ring, **(usual | chosen))

    def frames(self) -> list[PlannedFrame]:
        """Every planned frame, in rendering order."""
        return [
            PlannedFrame(f"L{location:02d}-V{view:03d}-{weather.name}", location, view, weather)
            for location in range(self.locations)
            for weather in self.weathers
            for view in range(self.views)
        ]

    def _check_whole(self, where: str) -> None:
        if not self.weathers:
            raise RaucaError(f"{where}: weathers must not be empty")
        planned = self.locations * len(self.weathers) * self.views
        if planned > MAX_FRAMES:
            raise RaucaError(f"{where}: plans {planned} frames; at most {MAX_FRAMES} are made in one data set")


def read_plan(folder: Path) -> Plan:
    """Read ``dataset.json``; raises :class:`RaucaError` when it is missing, damaged or from a newer rauca."""
    path = Path(folder) / "dataset.json"
    if not path.is_file():
        raise RaucaError(f"{folder}: not a data set (no dataset.json); make one with `rauca dataset make`")
    return Plan.from_json(read_json(path))


def claim_folder(folder: Path, plan: Plan) -> None:
    """Write the plan into an empty folder, or accept a folder that already holds the same plan.

    A different plan is refused rather than mixed in; only the Blender version, the name (folders are moved and
    renamed) and which GPU it was may differ, and are kept as first written.
    """
    path = Path(folder) / "dataset.json"
    if path.is_file():
        found = read_plan(folder)
        same_kind = (found.device == CPU) == (plan.device == CPU)
        device = found.device if same_kind else plan.device
        plan = replace(plan, blender=found.blender, name=found.name, device=device)
        if found != plan:
            ours, theirs = plan.to_json(), found.to_json()
            changed = [k for k in {**ours, **theirs} if ours.get(k) != theirs.get(k)]
            raise RaucaError(
                f"{folder}: holds a data set made with another {', '.join(changed)}; choose another folder or remove it"
            )
        return
    write_json(path, plan.to_json())
