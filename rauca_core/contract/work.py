"""Which frames a data set's plan asks for, who renders them, and in what order.

A *camera* is one view of one location. What is seen without weather (coverage, distances) is rendered once per camera,
so a camera's weathers stay together: shards split the cameras, chunks take a few cameras through every weather.

Of a plan too large to be rendered whole, a balanced part tells nearly as much about each parameter: every pair of
values meets equally often, as in a Latin square.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from itertools import combinations, groupby

import numpy as np
from numpy.typing import NDArray

from .errors import RaucaError
from .plan import Plan, PlannedFrame
from .schema import Record
from .seeding import named_rng
from .weather import Weather


@dataclass(frozen=True)
class Shard(Record):
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
    cameras = plan.locations * plan.views
    return (shard.index - 1) * cameras // shard.count, shard.index * cameras // shard.count


def planned_frames(plan: Plan, shard: Shard = WHOLE) -> list[PlannedFrame]:
    """The frames of a shard, in the plan's order; the shards of any split together are the plan."""
    views, (first, end) = plan.views, cameras_of(plan, shard)
    return [frame for frame in plan.frames() if first <= frame.location * views + frame.view < end]


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


_SINGLE_WEIGHT = 20.0  # a value's own share counts for more than that of its pairs


def balanced_frames(plan: Plan, count: int) -> list[str]:
    """Ids of ``count`` frames of a plan (all if it has no more), in the plan's order.

    Locations, azimuths, elevations, distances and weathers, and all pairs of them, are as even as a greedy choice makes
    them. The choice of fewer frames is part of the choice of more.
    """
    ring, weathers = plan.ring, len(plan.weathers)
    if plan.clips is not None:
        raise RaucaError("--frames: a part of a clip is no clip; ask for shorter ones with --clip-frames")
    shape = (plan.locations, weathers, len(ring.distances_m), len(ring.elevations_deg), len(ring.azimuths_deg))
    every = [frame.id for frame in plan.frames()]  # in just this order of axes
    chosen = range(len(every)) if count >= len(every) else sorted(_even_choice(shape, count, plan.seed).tolist())
    return [every[index] for index in chosen]


def _even_choice(shape: tuple[int, ...], count: int, seed: int) -> NDArray[np.int64]:
    """(count,) distinct flat indices into a grid: each is the point whose values, and pairs of them, were taken least.

    Equals are told apart by a seeded draw, once for all.
    """
    # The stream's name is that of its first use: another one would choose other views than published figures have.
    cost = named_rng("held-out views", seed).random(shape) * 1e-3
    axes = range(len(shape))
    subsets = [*combinations(axes, 1), *combinations(axes, 2)]
    chosen = []
    for _ in range(count):
        flat = int(cost.argmin())
        chosen.append(flat)
        point = np.unravel_index(flat, shape)
        for subset in subsets:
            sharing = tuple(int(point[axis]) if axis in subset else slice(None) for axis in axes)
            rarity = float(np.prod([shape[axis] for axis in subset]))
            cost[sharing] += rarity * (_SINGLE_WEIGHT if len(subset) == 1 else 1.0)
        cost[point] = np.inf
    return np.array(chosen, np.int64)
