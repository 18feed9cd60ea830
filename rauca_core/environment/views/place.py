"""The rendered views of one place in one weather, as other cameras there are composed from them.

Of every source rain, exposure and fog are taken out. Rain and exposure are put on a frame at the end of its making,
rain by a seed that the plan names, so that both can be undone to the bits that half precision keeps; fog is estimated,
see `fog_glow`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...contract import Dataset, Frame, Weather, load_passes
from ...contract.semantics import Instance
from ...runtime.images import read_image
from ..air import drops_of, without_rain
from ..exact import load_exact
from .fog_glow import FogGlow
from .lens import Lens, depth_of
from .sources import Sources, flying, mixed

SOLID = 252  # of 255: coverage from which a pixel is no edge


@dataclass(frozen=True, eq=False)
class Place:
    """N source frames of one location and weather.

    Attributes:
        frames: of the sources.
        around: everything but the vehicle: values B (3), labels semantic class and instance.
        painted: the vehicle's paint: values A per coverage (3) and B (3).
        rest: the vehicle's other parts: values B (3).
        categories: COCO class of the other vehicles by instance.
        fog: that lay before all values, and is taken out of them; None where there is none.
    """

    frames: tuple[Frame, ...]
    around: Sources
    painted: Sources
    rest: Sources
    categories: dict[int, str]
    fog: FogGlow | None = None

    @property
    def weather(self) -> Weather:
        return self.frames[0].weather

    @property
    def nbytes(self) -> int:
        """Of memory; parts of the vehicle and what surrounds it share their light."""
        arrays = (self.around.values, self.around.labels, self.painted.values)
        return sum(a.nbytes for a in arrays) + sum(s.depth.nbytes for s in (self.around, self.painted, self.rest))

    @staticmethod
    def of(dataset: Dataset, frames: Sequence[Frame]) -> Place:
        """Read the sources.

        Raises:
            RaucaError: files are missing or damaged.
            ValueError: frames of several places or weathers, or none.
        """
        if len({frame.place_and_weather for frame in frames}) != 1:
            raise ValueError("sources are of one location and weather")
        lenses = tuple(Lens.of(frame.camera) for frame in frames)
        around, painted, rest, gains, light, labels, depths = [], [], [], [], [], [], []
        for frame, lens in zip(frames, lenses, strict=True):
            folder = dataset.frame_folder(frame.id)
            covers, paint, semantic, instances = (
                read_image(folder / f"{name}.png") for name in ("vehicle", "paint", "semantic", "instances")
            )
            stored = load_passes(folder, ("distance",))["distance"]
            A, B = _undone(dataset, frame, stored)
            depth = depth_of(stored.astype(np.float32), lens)
            clean = ~mixed(depth)
            around.append(np.where(clean & (covers == 0), depth, 0))
            painted.append(np.where(clean & (paint >= SOLID), depth, 0))
            rest.append(np.where(clean & (covers >= SOLID) & (paint == 0), depth, 0))
            depths.append(np.where(clean, depth, np.float32(0)))
            gains.append(np.concatenate([A, B], -1))
            light.append(B)
            labels.append(np.stack([semantic, instances], -1))
        ids, whole, both = np.stack(labels), np.stack(light), np.stack(gains)
        seen = np.stack(depths)
        nothing = flying(lenses, seen)
        surroundings = np.where(nothing, 0, np.stack(around)).astype(np.float32)
        fog = FogGlow.of(frames[0].weather, lenses, seen, whole)
        if fog is not None:
            for n, lens in enumerate(lenses):
                left, glow = fog.at(lens, depths[n])
                whole[n] = np.maximum(whole[n] - glow, 0) / left[..., None]
                both[n, ..., :3] /= left[..., None]
                both[n, ..., 3:] = whole[n]
        others: list[Instance] = [other for frame in frames for other in frame.instances]
        return Place(
            tuple(frames),
            Sources(lenses, surroundings, whole, ids),
            Sources(lenses, np.stack(painted).astype(np.float32), both, ids),
            Sources(lenses, np.stack(rest).astype(np.float32), whole, ids),
            {other.id: other.category for other in others},
            fog,
        )

    def nearest(self, eye: NDArray[np.float64], number: int) -> NDArray[np.int64]:
        """The ``number`` sources whose cameras see the vehicle from the directions nearest to that of ``eye`` (3,)."""
        center = self.frames[0].vehicle_to_world[:3, 3]
        to = np.stack([lens.eye - center for lens in self.around.lenses] + [eye - center])
        to /= np.linalg.norm(to, axis=1, keepdims=True)
        return np.argsort(-(to[:-1] @ to[-1]), kind="stable")[:number]


def _undone(dataset: Dataset, frame: Frame, distance: NDArray[np.float16]) -> tuple[NDArray[np.float32], ...]:
    """A per coverage and B of a frame without its rain and exposure, (H, W, 3) each."""
    light = without_rain(load_exact(dataset, frame.id), drops_of(dataset, frame, distance))
    paint = read_image(dataset.frame_folder(frame.id) / "paint.png")
    dark = np.float32(2.0**-frame.exposure_stops)
    share = np.maximum(paint.astype(np.float32) / 255, 1 / 255)[..., None]
    return (light.A * dark / share).astype(np.float32), (light.B * dark).astype(np.float32)
