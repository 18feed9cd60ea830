"""New cameras in the places of a data set, and their frames: composed when they are asked for, nothing kept on disk."""

from __future__ import annotations

import logging
import math
import threading
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera, Dataset, Frame, Plan, PlannedFrame, RaucaError, Ring, by_place_and_weather, load_vehicle
from ...contract.color import srgb_to_linear
from ...contract.irradiance import irradiance_folder
from ...contract.seeding import named_seed
from ...contract.viewpoints import Shots, viewpoint
from ...render import Pyramid, Taps, TapSettings
from ...runtime.images import read_image
from ..exact import require_light
from ..irradiance import Irradiance
from ..paint_surface import LIGHT_SIZE, PaintSurface
from ..place_light import PlaceLight
from .compose import Composed, View, compose
from .place import Place

LOG = logging.getLogger(__name__)
MEMORY_MB = 2048
ENOUGH_SOURCES = 8
"""Rendered views of a place, all around it, below which new cameras see too little that is known (docs/views.md)."""
SAMPLES = 2  # per pixel and axis of taps built for their light alone: 4 gain .2 dB in the paint, for 100 ms more
JITTERS = ("jitter_azimuth_deg", "jitter_elevation_deg", "jitter_distance", "jitter_aim_m", "jitter_roll_deg")


class Views(Sequence[Composed]):
    """Frames of new cameras in the rendered places of a data set; each is composed when it is asked for.

    View i is a function of the data set, the ring, the seed and i: any number of processes compose the same frames, in
    any order. ``views[i]`` may be called from several threads. The light on the paint is that of the irradiance texture
    of its place and weather where the data set has one (`rauca dataset light`), else warped from the sources.

    Attributes:
        plan: of the new frames, as a data set of them has it.
        tasks: what is composed, view after view through all places and weathers.
    """

    def __init__(
        self,
        dataset: Dataset,
        n: int,
        ring: Ring | None = None,
        jitter: Ring | None = None,
        seed: int = 0,
        memory_mb: int = MEMORY_MB,
        pyramid: Pyramid | None = None,
    ) -> None:
        """Draw the cameras.

        Args:
            dataset: rendered, with light maps.
            n: how many views.
            ring: of the new cameras; by default one that fills the space between the data set's own.
            jitter: a ring whose jitters are taken in place of those of ``ring``.
            seed: names the jitter.
            memory_mb: of the sources that are kept in memory.
            pyramid: of the taps that :meth:`lit_through` is called with; None if of none.

        Raises:
            RaucaError: no light maps, no finished frames, frames that are composed themselves, n below 1, or a ring of
                fewer cameras than the views need.
        """
        require_light(dataset)
        self._sources = _sources(dataset)
        if n < 1:
            raise RaucaError(f"views: {n} is too few; ask for 1 or more")
        _tell_of_few(dataset, self._sources)
        number = math.ceil(n / len(self._sources))
        chosen = ring or ring_between(dataset.plan.ring, number)
        if jitter is not None:
            chosen = replace(chosen, **{name: getattr(jitter, name) for name in JITTERS})
        if len(chosen) < number:
            told = f"{n} views of {len(self._sources)} places and weathers need a ring of {number} cameras"
            raise RaucaError(f"views: {told}, this one has {len(chosen)}; give it more azimuths")
        there = {weather for _, weather in self._sources}
        weathers = tuple(weather for weather in dataset.plan.weathers if weather.name in there)
        self.plan = replace(dataset.plan, ring=chosen, weathers=weathers, recolor_share=0.0)
        self.dataset, self.seed = dataset, seed
        self.vehicle = load_vehicle(dataset.vehicle_folder, read_image)
        self.tasks = _tasks(self.plan, frozenset(self._sources), n)
        self._shots = Shots(chosen, self.plan.size, named_seed(self.plan.seed, "views", seed))
        self._center = (self.vehicle.positions.min(axis=0) + self.vehicle.positions.max(axis=0)).astype(np.float64) / 2
        self._reference = srgb_to_linear(np.array(self.plan.reference_srgb) / 255.0)
        self._budget = memory_mb * 2**20
        self._paint_light = PaintLight.of(dataset, pyramid)
        self._places: OrderedDict[tuple[int, str], tuple[Place, Irradiance | None]] = OrderedDict()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self.tasks)

    def __iter__(self) -> Iterator[Composed]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, index: int) -> Composed:  # type: ignore[override]
        """The frame of one view; raises :class:`RaucaError` when files of its sources are missing or damaged."""
        return self.lit_through(index)

    def lit_through(self, index: int, taps: Taps | None = None) -> Composed:
        """:meth:`__getitem__`, with taps of its camera that are there already."""
        task, gain = self.tasks[index], None
        place, light = self._place(task)
        if light is not None and self._paint_light is not None:
            gain = self._paint_light.gain(light, self.camera_in_vehicle(index), taps)
        return compose(place, self.view(task), self.vehicle, self._reference, self.plan.seed, gain)

    def camera_in_vehicle(self, index: int) -> Camera:
        """The camera of a view in the vehicle's frame."""
        task = self.tasks[index]
        pose = self._sources[task.place_and_weather][0].vehicle_to_world
        return self.view(task).camera.relative_to(pose)

    def view(self, task: PlannedFrame) -> View:
        """The camera of a task."""
        pose = self._sources[task.place_and_weather][0].vehicle_to_world
        seen_by = viewpoint(self._shots, task.location, task.view, pose, self._center)
        return View(
            task.id, task.location, task.view, seen_by.camera, seen_by.azimuth_deg, seen_by.elevation_deg,
            seen_by.distance_m, named_seed(self._shots.seed, task.id) % 2**31,
        )  # fmt: skip

    def _place(self, task: PlannedFrame) -> tuple[Place, Irradiance | None]:
        """The sources of a task and the light on its paint, from memory or read."""
        key = task.place_and_weather
        with self._lock:
            found = self._places.pop(key, None) or self._read(*key)
            self._places[key] = found
            while sum(map(_nbytes, self._places.values())) > self._budget and len(self._places) > 1:
                self._places.popitem(last=False)
        return found

    def _read(self, location: int, weather: str) -> tuple[Place, Irradiance | None]:
        place = Place.of(self.dataset, self._sources[location, weather])
        return place, self._paint_light.read(location, weather) if self._paint_light else None


class PaintLight:
    """The gain of the paint in new views, from the irradiance textures of a data set, for taps of one pyramid."""

    def __init__(self, dataset: Dataset, pyramid: Pyramid | None = None) -> None:
        """``pyramid``: that the taps read; by default that of the light textures themselves.

        Raises:
            RaucaError: a data set without light maps.
        """
        self._places = PlaceLight(dataset)
        self._surface = None if pyramid is None else PaintSurface.of(self._places.vehicle, pyramid)
        self._recipe = TapSettings(LIGHT_SIZE, SAMPLES)

    @staticmethod
    def of(dataset: Dataset, pyramid: Pyramid | None = None) -> PaintLight | None:
        """None where the data set has no irradiance textures; raises as the constructor does."""
        return PaintLight(dataset, pyramid) if (dataset.folder / "irradiance").is_dir() else None

    def read(self, location: int, weather: str) -> Irradiance | None:
        """The light of a place and weather, None where it was not fitted.

        Raises:
            RaucaError: it is damaged, or was fitted for another vehicle or finish.
        """
        if not irradiance_folder(self._places.dataset.folder, location, weather).is_dir():
            return None
        found = self._places.read(location, weather)
        return found if self._surface is None else found.on(self._surface)

    def gain(self, light: Irradiance, camera_in_vehicle: Camera, taps: Taps | None = None) -> NDArray[np.float32]:
        """What `compose` takes: (H, W, 3) linear per paint coverage, without rain and exposure; NaN off the taps.

        Args:
            light: of :meth:`read`.
            taps: of the camera, on the pyramid that this was made for; built if None, which needs the default one.
        """
        taps = taps or self._recipe.build(self._places.vehicle, camera_in_vehicle, light.surface.pyramid)
        image = np.full((taps.height * taps.width, 3), np.nan, np.float32)
        image[taps.pixels] = light.gain_of_paint(taps, camera_in_vehicle).numpy()
        return image.reshape(taps.height, taps.width, 3)


def ring_between(own: Ring, number: int) -> Ring:
    """A ring of at least ``number`` cameras whose jitter fills the space between the cameras of ``own``.

    Elevations and distances lie between the lowest and the highest of its own; where there is but one, they stray as
    far as its own do.
    """
    low, high = min(own.elevations_deg), max(own.elevations_deg)
    near, far = min(own.distances_m), max(own.distances_m)
    up, away = len(own.elevations_deg), len(own.distances_m)
    around = math.ceil(number / (up * away))
    elevations = tuple(low + (high - low) * (k + 0.5) / up for k in range(up))
    distances = tuple(near + (far - near) * (k + 0.5) / away for k in range(away))
    lifted = (high - low) / (2 * up) if high > low else own.jitter_elevation_deg
    moved = (far - near) / (2 * away * distances[-1]) if far > near else own.jitter_distance
    return replace(
        own, azimuths_deg=tuple(360.0 * k / around for k in range(around)), elevations_deg=elevations,
        distances_m=distances, jitter_azimuth_deg=180.0 / around, jitter_elevation_deg=lifted,
        jitter_distance=moved,
    )  # fmt: skip


def _nbytes(found: tuple[Place, Irradiance | None]) -> int:
    place, light = found
    return place.nbytes + (light.nbytes if light else 0)


def _sources(dataset: Dataset) -> dict[tuple[int, str], list[Frame]]:
    """Finished frames by location and weather."""
    frames = dataset.frames()
    if not frames:
        raise RaucaError(f"{dataset.folder}: no frame is finished; run `rauca dataset make --out {dataset.folder}`")
    dataset.require_rendered("new views are composed from")
    return by_place_and_weather(frames)


def _tell_of_few(dataset: Dataset, sources: dict[tuple[int, str], list[Frame]]) -> None:
    few = sum(len(frames) < ENOUGH_SOURCES for frames in sources.values())
    if few:
        LOG.warning(
            "note: %s: %d of %d places and weathers have fewer than %d rendered views; what new cameras see there is "
            "guessed in part; give `rauca dataset make` eight azimuths or more",
            dataset.folder, few, len(sources), ENOUGH_SOURCES,
        )  # fmt: skip


def _tasks(plan: Plan, places: frozenset[tuple[int, str]], n: int) -> list[PlannedFrame]:
    """The first n of all views, one of every place and weather after the other."""
    tasks = [task for task in plan.frames() if task.place_and_weather in places]
    return sorted(tasks, key=lambda task: task.view)[:n]
