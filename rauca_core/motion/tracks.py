"""Tracks of a clip: what detectors find in frame after frame, joined by a tracker of the library `trackers`.

The library (Apache-2.0) asks for NumPy 2 and for an OpenCV that takes the place of ours; it needs neither for these
trackers. `docs/motion.md` says how it is installed without them.

Sources: Bewley et al., Simple Online and Realtime Tracking, ICIP 2016; Zhang et al., ByteTrack, ECCV 2022.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import RaucaError

TRACKERS = ("bytetrack", "sort")
NEEDED = ("trackers", "supervision")
SURE = 0.5  # a score from which a detection may begin a track; ByteTrack's paper takes .6 and .7, on larger detectors
FAINT = 0.1  # ByteTrack goes on with a track by detections down to this; below lies noise
BUFFER_FRAMES = 30  # at 30 frames a second, and the library scales it: a track is remembered for a second


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes of one frame.

    Attributes:
        xyxy: (M, 4) float64, pixels.
        values: (M,) scores of detections, in [0, 1]; or, of a tracker's answer or of the truth, int64 ids.
    """

    xyxy: NDArray[np.float64]
    values: NDArray[Any]

    def __len__(self) -> int:
        return len(self.xyxy)

    def where(self, kept: NDArray[np.bool_]) -> Boxes:
        """Those that are kept."""
        return Boxes(self.xyxy[kept], self.values[kept])


def track(found: Sequence[Boxes], frame_rate: float, tracker: str = "bytetrack") -> list[Boxes]:
    """Join a clip's detections of one class into tracks.

    Args:
        found: of each frame, in order, with scores.
        frame_rate: frames a second.
        tracker: one of ``TRACKERS``.

    Returns:
        Of each frame, the boxes that belong to a confirmed track, with its id; ids count from 1 as tracks appear.

    Raises:
        RaucaError: no such tracker, or the library is not installed.
    """
    joined, ids = _tracker(tracker, frame_rate), dict[int, int]()
    lowest, told = (FAINT if tracker == "bytetrack" else SURE), []
    for boxes in found:
        seen = boxes.where(boxes.values >= lowest)
        answer = joined.update(_as_supervision(seen))
        numbers = np.asarray(answer.tracker_id if answer.tracker_id is not None else [], np.int64)
        confirmed = numbers >= 0
        for number in numbers[confirmed].tolist():
            ids.setdefault(number, len(ids) + 1)
        own = np.array([ids[number] for number in numbers[confirmed].tolist()], np.int64)
        told.append(Boxes(np.asarray(answer.xyxy, float).reshape(-1, 4)[confirmed], own))
    return told


def require_trackers() -> None:
    """Raise :class:`RaucaError` unless the library of trackers is installed."""
    if missing := [name for name in NEEDED if importlib.util.find_spec(name) is None]:
        raise RaucaError(
            f"tracking needs the package {missing[0]}: `pip install --no-deps trackers supervision pydeprecate "
            "defusedxml` (with its dependencies, it would replace NumPy and OpenCV)"
        )


def _tracker(name: str, frame_rate: float) -> Any:
    require_trackers()
    from trackers import ByteTrackTracker, SORTTracker

    common: dict[str, Any] = {"lost_track_buffer": BUFFER_FRAMES, "frame_rate": frame_rate}
    if name == "bytetrack":
        # An own track begins above "activation"; what lies above "high" is joined first.
        return ByteTrackTracker(**common, track_activation_threshold=SURE, high_conf_det_threshold=SURE)
    if name == "sort":
        return SORTTracker(**common, track_activation_threshold=SURE)
    raise RaucaError(f"--tracker {name}: must be one of {', '.join(TRACKERS)}")


def _as_supervision(boxes: Boxes) -> Any:
    import supervision

    if len(boxes) == 0:
        return supervision.Detections.empty()
    return supervision.Detections(
        xyxy=boxes.xyxy.astype(np.float32),
        confidence=boxes.values.astype(np.float32),
        class_id=np.zeros(len(boxes), np.int64),
    )
