"""What a process is started for, and how it tells how far it is.

A job is one file, written by whoever wants the work, read by the Blender that does it::

    {"format": "rauca-job", "version": 1, "task": "make_dataset", "out": "set", "plan": {...}, ...}

The fields beside ``format``, ``version`` and ``task`` are those of the task's class below. Paths are relative to the
folder that the process is started in. Progress is a JSON object a line, on standard output.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, ClassVar, get_args

from .errors import RaucaError
from .files import write_json
from .plan import Plan, PlannedFrame
from .reading import parse_json
from .schema import Record, read_json
from .work import WHOLE, Shard, planned_frames

DEVICES = ("cpu", "gpu", "auto")
RECYCLE = 200
_FORMAT = ("rauca-job", 1)


@dataclass(frozen=True)
class VehicleSource(Record):
    """Which vehicle is meant.

    Attributes:
        name: of a shipped vehicle; or the path of a vehicle folder, or of an .obj, .glb or .blend file.
        paint_mask: grey PNG, white where the camouflage may go; of a file only.
        paint_material: name of the material to camouflage; of a file only.
    """

    name: str = "sedan"
    paint_mask: Path | None = None
    paint_material: str | None = None


SEDAN = VehicleSource()


@dataclass(frozen=True)
class MakeDataset(Record):
    """Render the frames that a data set lacks.

    Attributes:
        out: folder of the data set.
        plan: of all frames. Blender fills in what only it knows: its version, the device, and the vehicle's name and
            atlas (where the plan names an atlas, another one is refused).
        vehicle: whose frames these are.
        scene: a .blend of the user's instead of the town.
        frames: ids of those that are wanted; the plan's other frames are left for later. None: all.
        shard: only this part of the frames.
        workers: Blender processes at once.
        recycle: frames after which a worker is replaced by a fresh one.
        retry_quarantined: try frames again that failed twice.
        device: that Cycles renders on: ``cpu``, ``gpu``, or ``auto``, which is a GPU where there is one.
        notes: what the user should be told of the request, a line each.
    """

    task: ClassVar[str] = "make_dataset"
    out: Path
    plan: Plan
    vehicle: VehicleSource = SEDAN
    scene: Path | None = None
    frames: tuple[str, ...] | None = None
    shard: Shard = WHOLE
    workers: Annotated[int, (1, 4096)] = 1
    recycle: Annotated[int, (1, 2**31)] = RECYCLE
    retry_quarantined: bool = False
    device: Annotated[str, DEVICES] = "cpu"
    notes: tuple[str, ...] = ()

    def wanted(self) -> list[PlannedFrame]:
        """The frames of the shard that are asked for, in order; raises :class:`RaucaError` for a stranger."""
        planned = planned_frames(self.plan, self.shard)
        if self.frames is None:
            return planned
        asked = frozenset(self.frames)
        require_planned(asked, self.plan, str(self.out))
        return [frame for frame in planned if frame.id in asked]


@dataclass(frozen=True)
class RenderFrames(Record):
    """Be a worker of :class:`MakeDataset`: render the frames that standard input names.

    Attributes:
        plan: folder with ``dataset.json`` and ``vehicle/``.
        out: folder of the data set.
        scene: a .blend of the user's instead of the town.
        threads: 0: as many as there are cores.
        device: as of :class:`MakeDataset`.
    """

    task: ClassVar[str] = "render_frames"
    plan: Path
    out: Path
    scene: Path | None = None
    threads: int = 0
    device: Annotated[str, DEVICES] = "cpu"


@dataclass(frozen=True)
class RenderCamouflages(Record):
    """Render a data set's views in camouflages.

    Attributes:
        dataset: whose views are rendered.
        out: images go to ``out/<camouflage>/<frame>.png``.
        camouflages: their .json files, each with a name of its own.
        frames: ids of the frames that are wanted; None: all that are finished.
        samples: paths per pixel; None: as many as the data set has.
        denoise: use Open Image Denoise.
        scene: the .blend that the data set was made in, if it was.
        threads: 0: as many as there are cores.
        device: as of :class:`MakeDataset`.
    """

    task: ClassVar[str] = "render_camouflages"
    dataset: Path
    out: Path
    camouflages: tuple[Path, ...]
    frames: tuple[str, ...] | None = None
    samples: int | None = None
    denoise: bool = True
    scene: Path | None = None
    threads: int = 0
    device: Annotated[str, DEVICES] = "cpu"


@dataclass(frozen=True)
class ApplyCamouflage(Record):
    """Save a vehicle in camouflage as the .blend ``out``."""

    task: ClassVar[str] = "apply_camouflage"
    out: Path
    camouflage: Path
    vehicle: VehicleSource = SEDAN


@dataclass(frozen=True)
class ImportVehicle(Record):
    """Save a vehicle as the vehicle folder ``out``, whatever it comes from."""

    task: ClassVar[str] = "import_vehicle"
    out: Path
    vehicle: VehicleSource = SEDAN


@dataclass(frozen=True)
class UnwrapVehicle(Record):
    """Read a vehicle folder, and write it to ``out`` with a new UV atlas for its paint."""

    task: ClassVar[str] = "unwrap_vehicle"
    vehicle: Path
    out: Path


Job = MakeDataset | RenderFrames | RenderCamouflages | ApplyCamouflage | ImportVehicle | UnwrapVehicle
TASKS: dict[str, type[Job]] = {kind.task: kind for kind in get_args(Job)}


def require_planned(frames: Iterable[str], plan: Plan, where: str) -> None:
    """Raise :class:`RaucaError` naming ``where`` if there is no frame, or one that a plan does not have."""
    asked = frozenset(frames)
    strangers = asked.difference(frame.id for frame in plan.frames())
    if strangers or not asked:
        stranger = min(strangers, default="no frame at all")
        raise RaucaError(f"{where}: names {stranger}, which the data set does not plan; one id per line")


def save_job(path: Path, job: Job) -> None:
    """Write a job's file."""
    name, version = _FORMAT
    write_json(path, {"format": name, "version": version, "task": job.task, **job.to_json()})


def load_job(path: Path) -> Job:
    """Read a job's file; raises :class:`RaucaError` when it is missing or damaged."""
    read = read_json(path)
    read.format(*_FORMAT)
    kind = TASKS[read.choice("task", tuple(TASKS))]
    return kind.from_json(read)


_MARK = "rauca-progress "


@dataclass(frozen=True)
class Progress:
    """``done`` of ``total`` items; ``last`` names the newest, ``left_s`` estimates the seconds left, if known."""

    done: int
    total: int
    last: str
    left_s: float | None = None

    def line(self) -> str:
        """The line to print."""
        return _MARK + json.dumps(asdict(self))


def parse_progress(line: str) -> Progress | None:
    """The progress a line tells, or None for any other line."""
    if not line.startswith(_MARK):
        return None
    try:
        return Progress(**parse_json(line.removeprefix(_MARK), "progress"))
    except (RaucaError, TypeError):  # two processes wrote at once, or it is none of ours
        return None


@dataclass(frozen=True)
class OptimizeProgress:
    """One line on standard output.

    Attributes:
        step: steps done, ``of`` so many; a resumed run goes on counting where it stopped.
        of: steps in all.
        loss: Eq. 8; ``attack`` and ``smooth`` are its terms without their weights.
        score: max H_d, mean over the batch: how well the detectors still see the vehicle, in [0, 1].
        seconds: that the step took.
        left_s: estimate of the seconds left.
        preview: path of a PNG that shows the UV map and a frame in the paint, side by side; replaced as the run goes.
        uv_map: path of a PNG of the UV map alone, at most 512 texels a side; replaced likewise.
    """

    step: int
    of: int
    loss: float
    attack: float
    smooth: float
    score: float
    seconds: float
    left_s: float
    preview: str
    uv_map: str

    def line(self) -> str:
        """The line to print."""
        return json.dumps(asdict(self), allow_nan=False)


def parse_optimize_progress(line: str) -> OptimizeProgress | None:
    """The progress that a line tells, or None for any other line; fields of later versions are left out."""
    try:
        told = parse_json(line, "progress")
        return OptimizeProgress(**{name: told[name] for name in OptimizeProgress.__dataclass_fields__})
    except (RaucaError, KeyError, TypeError):
        return None


def format_duration(seconds: float) -> str:
    """A duration for people: ``45 s``, ``12 min``, ``3 h 20 min``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
