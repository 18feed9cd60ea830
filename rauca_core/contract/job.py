"""What a Blender process is started for: one file, written by whoever wants the work, read by the Blender that does it.

::

    {"format": "rauca-job", "version": 1, "task": "make_dataset", "out": "set", "plan": {...}, ...}

The fields beside ``format``, ``version`` and ``task`` are those of the task's class below. Paths are relative to the
folder that the process is started in.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, get_args

from .errors import RaucaError
from .files import write_json
from .plan import Plan
from .schema import Record, read_json
from .work import WHOLE, PlannedFrame, Shard, planned_frames

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
    strangers = asked.difference(frame_id for frame_id, *_ in plan.frame_ids())
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
