"""Which frames a data set's plan asks for, who renders them, and in what order.

A *camera* is one view of one location. What is seen without weather (coverage, distances) is rendered once per camera,
so a camera's weathers stay together: shards split the cameras, chunks take a few cameras through every weather.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from typing import NamedTuple

from .dataset import Plan
from .errors import RaucaError
from .weather import Weather


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


@dataclass(frozen=True)
class Shard:
    """Part ``index`` of ``count``, counted from 1."""

    index: int = 1
    count: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.index <= self.count:
            raise RaucaError(f"shard {self.index}/{self.count}: parts are counted from 1/{self.count}")

    @staticmethod
    def parse(text: str) -> Shard:
        """Read ``i/n``; raises :class:`RaucaError` for anything else."""
        match = re.fullmatch(r"(\d+)/(\d+)", text)
        if match is None:
            raise RaucaError(f"shard {text!r} must be i/n with i from 1 to n, for example 1/4")
        return Shard(int(match[1]), int(match[2]))

    @property
    def label(self) -> str:
        """For file names: ``2of4``; empty for a whole data set."""
        return f"{self.index}of{self.count}" if self.count > 1 else ""

    def __str__(self) -> str:
        return f"{self.index}/{self.count}"


WHOLE = Shard()


def cameras_of(plan: Plan, shard: Shard) -> tuple[int, int]:
    """First and one past the last of a shard's cameras; camera ``location * views + view``.

    The cameras are cut into ``count`` runs whose lengths differ by at most one, so a shard visits few locations.
    """
    cameras = plan.locations * len(plan.ring)
    return (shard.index - 1) * cameras // shard.count, shard.index * cameras // shard.count


def planned_frames(plan: Plan, shard: Shard = WHOLE) -> list[PlannedFrame]:
    """The frames of a shard, in the plan's order; the shards of any split together are the plan."""
    views, (first, end) = len(plan.ring), cameras_of(plan, shard)
    frames = (PlannedFrame(*frame) for frame in plan.frame_ids())
    return [frame for frame in frames if first <= frame.location * views + frame.view < end]


def in_rendering_order(weathers: Collection[Weather]) -> list[Weather]:
    """Weathers with one light together, fog growing: what is composed from a clear frame comes after it."""
    suns = list(dict.fromkeys(_light(weather) for weather in weathers))
    return sorted(weathers, key=lambda weather: (suns.index(_light(weather)), weather.extinction))


def chunks(plan: Plan, frames: Collection[PlannedFrame], most: int) -> Iterator[list[PlannedFrame]]:
    """Cut frames into pieces of work, each a few cameras of one location in rendering order.

    Args:
        frames: those still to be rendered, in the plan's order.
        most: frames per chunk; a camera with more weathers than that is cut.
    """
    weathers = {weather: rank for rank, weather in enumerate(in_rendering_order(plan.weathers))}
    by_camera = sorted(frames, key=lambda frame: (frame.camera, weathers[frame.weather]))
    chunk: list[PlannedFrame] = []
    for _, group in groupby(by_camera, key=lambda frame: frame.camera):
        camera = list(group)
        for part in (camera[i : i + most] for i in range(0, len(camera), most)):
            if chunk and (chunk[0].location != part[0].location or len(chunk) + len(part) > most):
                yield chunk
                chunk = []
            chunk = sorted(chunk + part, key=lambda frame: (weathers[frame.weather], frame.view))
    if chunk:
        yield chunk


def _light(weather: Weather) -> tuple[float, ...]:
    """What the weather's light would be without its fog."""
    return replace(weather, fog_density=0.0).light_key()
