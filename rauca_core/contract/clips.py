"""Clips: a camera that drives, and a vehicle that does or stands, along a street at stated speeds.

A clip's frames are ordinary frames of a data set: the views of a location are the frames of its clips, one clip after
the other. Where camera and vehicle are at a time is a function of the plan and the street.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from .camera import Camera
from .errors import RaucaError
from .schema import Record

MANOEUVRES = ("approach", "overtaken", "crossing", "cut-in", "passing", "following")
LANE_M = 3.2
EYE_M = 1.4  # height of the camera, behind a windscreen
LOOKS_AT_M = (20.0, 0.0, 0.6)  # ahead of the camera's car, on the ground
NEAREST_M = 6.0  # at the end of an approach: from the camera to the vehicle's middle
LANE_CHANGE_S = 2.5  # a hasty one; done when the clip ends, so a shorter clip begins in its midst
BEHIND_M = 10.0  # kept when following, and when another cuts in
FARTHEST_M = 0.5  # that the camera may move while a frame is exposed


@dataclass(frozen=True)
class Clips(Record):
    """What is driven at every location in every weather.

    Attributes:
        manoeuvres: of ``MANOEUVRES``; each is a clip.
        frames: of each clip.
        speed_m_s: of the camera; what else moves has a speed that follows from it, see :func:`moves`.
        frame_rate: frames a second.
        shutter_s: that each row is exposed; 0: no motion blur.
        readout_s: by which the last row is exposed later than the first, with a frame's time in the middle: a rolling
            shutter; 0: all rows at once.
    """

    manoeuvres: tuple[str, ...]
    frames: Annotated[int, (1, 100_000)] = 30
    speed_m_s: Annotated[float, (0.1, 100)] = 10.0
    frame_rate: Annotated[float, (0.1, 1000)] = 15.0
    shutter_s: Annotated[float, (0, 10)] = 0.0
    readout_s: Annotated[float, (0, 10)] = 0.0

    def to_json(self) -> dict[str, Any]:
        """As of any record; a shutter that opens for all rows at once says nothing of a readout, as before."""
        told = super().to_json()
        return told if self.readout_s else {name: value for name, value in told.items() if name != "readout_s"}

    def __len__(self) -> int:
        """Views of a location."""
        return len(self.manoeuvres) * self.frames

    @property
    def length_s(self) -> float:
        """From the first frame to the last."""
        return (self.frames - 1) / self.frame_rate

    @property
    def open_s(self) -> float:
        """From when the first row's exposure begins to when the last row's ends."""
        return self.shutter_s + self.readout_s

    def at(self, view: int) -> tuple[str, float]:
        """The manoeuvre of a view, and the time since the clip's begin, seconds."""
        return self.manoeuvres[view // self.frames], view % self.frames / self.frame_rate

    def _check_whole(self, where: str) -> None:
        strange = [name for name in self.manoeuvres if name not in MANOEUVRES]
        if strange or not self.manoeuvres or len(set(self.manoeuvres)) < len(self.manoeuvres):
            told = strange[0] if strange else "none, or one twice"
            raise RaucaError(f"{where}: {told}: clips are any of {', '.join(MANOEUVRES)}, each once")
        if self.frames < 2:
            raise RaucaError(f"{where}: a clip of one frame shows no motion; ask for two frames or more")
        if self.shutter_s * self.frame_rate > 1:
            raise RaucaError(
                f"{where}: a shutter open for {self.shutter_s:g} s does not close between frames, of which there are "
                f"{self.frame_rate:g} a second; open it for at most {1 / self.frame_rate:.3g} s"
            )
        if self.readout_s * self.frame_rate > 1:
            raise RaucaError(
                f"{where}: a readout of {self.readout_s:g} s is not done when the next frame begins, of which there "
                f"are {self.frame_rate:g} a second; read out in at most {1 / self.frame_rate:.3g} s"
            )
        if self.speed_m_s * self.open_s > FARTHEST_M:
            raise RaucaError(
                f"{where}: {self.speed_m_s:g} m/s is {self.speed_m_s * self.open_s:.2g} m while a frame is exposed "
                f"(shutter and readout), more than the {FARTHEST_M} m that are rendered of motion; drive more slowly "
                "or shorten the two"
            )


def clips_asked(
    manoeuvres: str, frames: int, speed_m_s: float, frame_rate: float, shutter_s: float, readout_s: float = 0.0
) -> Clips:
    """Clips as they are typed: ``all`` or names, comma separated; raises :class:`RaucaError` for a mistake."""
    names = MANOEUVRES if manoeuvres == "all" else tuple(manoeuvres.split(","))
    clips = Clips(names, frames, speed_m_s, frame_rate, shutter_s, readout_s)
    clips.check("--clips")
    return clips


def clip_name(clips: Clips, location: int, view: int, weather: str) -> str:
    """Names a clip in a data set."""
    return f"L{location:02d}-{clips.at(view)[0]}-{weather}"


@dataclass(frozen=True, eq=False)
class Street:
    """The lane on which a vehicle stands.

    Attributes:
        pose: (4, 4) lane to world: the vehicle's place on the ground, x along the lane, y to its left.
        curvature: of the lane, 1/m, positive to the left.
    """

    pose: NDArray[np.float64]
    curvature: float = 0.0

    def at(self, spot: Spot) -> NDArray[np.float64]:
        """(4, 4) frame of a spot to world."""
        angle, k = self.curvature * spot.along, self.curvature
        x, y = (math.sin(angle) / k, (1 - math.cos(angle)) / k) if k else (spot.along, 0.0)
        return np.asarray(self.pose @ _turned(angle, x, y) @ _turned(spot.heading, 0.0, spot.aside))


@dataclass(frozen=True)
class Spot:
    """Metres along the lane and to its left, and the heading against the lane's, radians."""

    along: float = 0.0
    aside: float = 0.0
    heading: float = 0.0


def moves(clips: Clips, view: int, later_s: float = 0.0) -> tuple[Spot, Spot]:
    """Where camera and vehicle are.

    Args:
        later_s: after the view's time; for what moves while the shutter is open.
    """
    name, time = clips.at(view)
    t, whole, v = time + later_s, clips.length_s, clips.speed_m_s
    middle = v * (t - whole / 2)  # of who drives at the camera's speed, about the vehicle's place
    if name == "approach":  # towards a standing vehicle, from behind
        return Spot(-NEAREST_M - v * (whole - t)), Spot()
    if name == "passing":  # the same in the lane to its left, until it leaves the picture
        return Spot(LANE_M - NEAREST_M - v * (whole - t), LANE_M), Spot()
    if name == "following":
        return Spot(middle - BEHIND_M), Spot(middle)
    if name == "overtaken":  # by a vehicle half as fast again, on the left
        return Spot(middle - NEAREST_M), Spot(middle - NEAREST_M + 2.0 + v / 2 * t, LANE_M)
    if name == "crossing":  # a vehicle at half the speed, from left to right
        return Spot(-BEHIND_M - v * (whole - t)), Spot(0.0, v / 2 * (whole / 2 - t), -math.pi / 2)
    share = min(max(1 - (whole - t) / LANE_CHANGE_S, 0.0), 1.0)  # cut-in: from the left, and a fifth slower
    slope = -LANE_M * 6 * share * (1 - share) / LANE_CHANGE_S
    aside = LANE_M * (1 - share * share * (3 - 2 * share))
    return Spot(middle - BEHIND_M), Spot(0.8 * middle, aside, math.atan2(slope, 0.8 * v))


def driving_camera(street: Street, spot: Spot, fov_deg: float, size: int) -> Camera:
    """The camera of a car at a spot, looking ahead."""
    frame = street.at(spot)
    eye, target = (frame @ np.array([*point, 1.0]) for point in ((0.0, 0.0, EYE_M), LOOKS_AT_M))
    return Camera.look_at(eye[:3], target[:3], fov_deg, size, size)


def _turned(angle: float, x: float, y: float) -> NDArray[np.float64]:
    frame = np.eye(4)
    cosine, sine = math.cos(angle), math.sin(angle)
    frame[:2, :2] = [[cosine, -sine], [sine, cosine]]
    frame[:2, 3] = x, y
    return frame
