"""What a study of clips says beyond AP: warning lost, gaps, breaks, HOTA, from the detections that it keeps.

Nothing is rendered or detected here. Every detector's boxes go through a tracker, clip by clip; a track on another
vehicle than the data set's is left out, as is what detects one.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from ..contract import Dataset, Frame, RaucaError
from ..contract.files import write_json
from ..contract.schema import Record
from ..detect import canonical
from ..motion.metrics import SAME, follow, hota, overlap
from ..motion.tracks import Boxes, require_trackers, track
from ..motion.warning import Drive, Figures, figures
from .candidates import NORMAL
from .intervals import spread
from .study import Entry, Study

FILE_NAME = "drives.json"  # clips.json holds the numbers of the page, as of every page
CAR = 1  # the data set's vehicle among the ids of a clip
NOTHING = Boxes(np.zeros((0, 4)), np.zeros(0))
Told = tuple[str, str, str, str, str]  # vehicle, weathers, defence, paint, detector


@dataclass(frozen=True)
class Mean(Record):
    """A mean over clips and its 95 % interval; None where a single clip tells none."""

    value: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class ClipFigures(Record):
    """One clip, one paint, one detector; fields as of :class:`~rauca_core.motion.warning.Figures`."""

    clip: str
    vehicle: str
    weathers: str
    defence: str
    paint: str
    detector: str
    late_s: float
    late_m: float
    gap_s: float
    blind: float | None
    breaks: int
    switches: int
    hota: float


@dataclass(frozen=True)
class Driven(Record):
    """All clips of a vehicle in a set of weathers and in a paint, seen by a detector.

    Attributes:
        ap: AP@0.5 of the same frames; over several vehicles, the mean of theirs.
        lost_m, lost_s: warning lost against the plain vehicle in the same clips.
        gap_s: the longest gap of all clips.
        blind: mean share within braking distance without a track; None where no clip comes that close.
        breaks, switches: in all clips together.
        hota: mean over clips.
    """

    vehicle: str
    weathers: str
    defence: str
    paint: str
    detector: str
    clips: int
    ap: float
    lost_m: Mean
    lost_s: Mean
    gap_s: float
    blind: float | None
    breaks: int
    switches: int
    hota: float


@dataclass(frozen=True)
class Drives(Record):
    """What a study of clips says."""

    FORMAT = ("rauca-clips", 2)

    tracker: str
    rows: tuple[Driven, ...]
    clips: tuple[ClipFigures, ...]


@dataclass(frozen=True, eq=False)
class Clip:
    """A clip of an entry: its frames in order, and the index of each among the results' (None: no vehicle in it)."""

    name: str
    frames: Sequence[Frame]
    places: Sequence[int | None]

    @property
    def truth(self) -> list[Boxes]:
        """The data set's vehicle in each frame."""
        return [
            Boxes(np.array([frame.box_xyxy] if frame.box_xyxy else []).reshape(-1, 4), _one(frame))
            for frame in self.frames
        ]

    @property
    def drive(self) -> Drive:
        return Drive(*(np.array([getattr(f, name) for f in self.frames]) for name in ("time_s", "distance_m")))


def has_clips(study: Study) -> bool:
    """Whether any of a study's views are clips."""
    return any(clips_of(entry) for entry in study.entries)


def clips_of(entry: Entry) -> list[Clip]:
    """The clips of an entry that show the vehicle in at least two frames; none of still views."""
    if entry.views is None or Dataset(entry.views).plan.clips is None:
        return []
    index = {row.id: place for place, row in enumerate(entry.results.frames)}
    found: defaultdict[str, list[Frame]] = defaultdict(list)
    for frame in Dataset(entry.views).frames():
        found[frame.clip].append(frame)
    clips = []
    for name, frames in found.items():
        frames.sort(key=lambda frame: frame.time_s)
        places = [index.get(frame.id) for frame in frames]
        if len(places) - places.count(None) > 1:
            clips.append(Clip(name, frames, places))
    return clips


def tracked(entry: Entry, clip: Clip, detector: str, paint: str, tracker: str) -> list[Boxes]:
    """The tracks of a clip, without those on other vehicles."""
    found = []
    for place in clip.places:
        cars = None if place is None else entry.recorded.found(detector, paint, place).only(canonical(entry.category))
        found.append(NOTHING if cars is None else Boxes(cars.boxes, cars.scores))
    tracks = track(found, 1 / clip.drive.frame_s, tracker)
    return [_without_others(boxes, frame) for boxes, frame in zip(tracks, clip.frames, strict=True)]


def measure_drives(study: Study, tracker: str = "bytetrack") -> Drives:
    """Track every clip of a study and read its figures.

    Raises:
        RaucaError: no tracker, no clips, or no plain vehicle to compare with.
    """
    require_trackers()
    every, aps = list[ClipFigures](), dict[Told, float]()
    for entry in study.entries:
        clips = clips_of(entry)
        if clips and NORMAL not in entry.results.paints:
            raise RaucaError(f"{entry.folder}: lacks the plain vehicle, against which warning is lost; evaluate again")
        for detector in entry.results.detectors if clips else ():
            for paint in entry.results.paints:
                told = (entry.vehicle, entry.weathers, entry.defence, paint, detector)
                aps[told] = entry.results.table[paint][detector].ap
                for clip in clips:
                    found = _figures(entry, clip, detector, paint, tracker)
                    every.append(ClipFigures(clip.name, *told, **asdict(found)))
    if not every:
        raise RaucaError("evaluate: none of the views are clips; make some with `rauca dataset make --clips`")
    return Drives(tracker, _rows(every, aps), tuple(every))


def over_vehicles(drives: Drives) -> Drives:
    """The same with one row for all vehicles together; the clips stay as they are."""
    called = ", ".join(dict.fromkeys(row.vehicle for row in drives.rows))
    aps: defaultdict[Told, list[float]] = defaultdict(list)
    for row in drives.rows:
        aps[called, row.weathers, row.defence, row.paint, row.detector].append(row.ap)
    together = [replace(clip, vehicle=called) for clip in drives.clips]
    return replace(drives, rows=_rows(together, {told: float(np.mean(some)) for told, some in aps.items()}))


def save_drives(folder: Path, drives: Drives) -> Path:
    """Write ``drives.json``."""
    write_json(folder / FILE_NAME, drives.to_json())
    return folder / FILE_NAME


def most_lost(drives: Drives) -> Driven | None:
    """The paint and detector that lose most warning against the plain vehicle; None without a camouflage."""
    painted = [row for row in drives.rows if row.paint != NORMAL]
    return max(painted, key=lambda row: (row.lost_s.value, row.gap_s), default=None)


def _figures(entry: Entry, clip: Clip, detector: str, paint: str, tracker: str) -> Figures:
    truth, tracks = clip.truth, tracked(entry, clip, detector, paint, tracker)
    return figures(clip.drive, follow(truth, tracks)[CAR], hota(truth, tracks).hota)


def _rows(every: Sequence[ClipFigures], aps: Mapping[Told, float]) -> tuple[Driven, ...]:
    """A row for each of ``aps``, from its clips and those of the plain vehicle, which come in the same order."""
    found: defaultdict[Told, list[ClipFigures]] = defaultdict(list)
    for clip in every:
        found[clip.vehicle, clip.weathers, clip.defence, clip.paint, clip.detector].append(clip)
    return tuple(_row(told, ap, found[told], found[*told[:3], NORMAL, told[4]]) for told, ap in aps.items())


def _row(told: Told, ap: float, found: Sequence[ClipFigures], plain: Sequence[ClipFigures]) -> Driven:
    close = [one.blind for one in found if one.blind is not None]
    return Driven(
        *told,
        clips=len(found),
        ap=ap,
        lost_m=_mean([one.late_m - other.late_m for one, other in zip(found, plain, strict=True)]),
        lost_s=_mean([one.late_s - other.late_s for one, other in zip(found, plain, strict=True)]),
        gap_s=max(one.gap_s for one in found),
        blind=float(np.mean(close)) if close else None,
        breaks=sum(one.breaks for one in found),
        switches=sum(one.switches for one in found),
        hota=float(np.mean([one.hota for one in found])),
    )


def _mean(values: Sequence[float]) -> Mean:
    """The mean with a jackknife's interval; clips are what is left out."""
    each = np.array(values, np.float64)
    if len(each) < 2:
        return Mean(float(each[0]))
    curve = np.append(each.mean(), (each.sum() - each) / (len(each) - 1))
    reach = spread(curve).reach
    return Mean(float(each.mean()), float(each.mean() - reach), float(each.mean() + reach))


def _one(frame: Frame) -> np.ndarray:
    return np.array([CAR] if frame.box_xyxy else [], np.int64)


def _without_others(boxes: Boxes, frame: Frame) -> Boxes:
    """Without those that overlap another vehicle, and that one more than ours."""
    if not frame.instances or not len(boxes):
        return boxes
    others = overlap(boxes.xyxy, np.array([other.box_xyxy for other in frame.instances], np.float64)).max(1)
    ours = overlap(boxes.xyxy, np.array([frame.box_xyxy], np.float64))[:, 0] if frame.box_xyxy else np.zeros(len(boxes))
    return boxes.where(~((others >= SAME) & (others > ours)))


def by_detector(drives: Drives) -> Mapping[tuple[str, str, str, str], list[Driven]]:
    """Rows of each vehicle, set of weathers, defence and detector."""
    found: defaultdict[tuple[str, str, str, str], list[Driven]] = defaultdict(list)
    for row in drives.rows:
        found[row.vehicle, row.weathers, row.defence, row.detector].append(row)
    return found
