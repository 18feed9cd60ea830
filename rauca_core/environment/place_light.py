"""The irradiance textures of a data set: fitted for every place and weather, kept with it, and read as light maps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Frame, Progress, RaucaError, Vehicle, by_place_and_weather, load_vehicle
from ..contract.irradiance import StoredLight, irradiance_folder, load_irradiance, save_irradiance
from ..render import TapCache, Taps, TapSettings
from ..runtime.images import read_image
from .air import drops_of, without_rain
from .exact import Light, load_exact, require_light
from .frames import read_picture
from .irradiance import KNOWN, SEEN, Irradiance, Source, fit_place, held_out, optics_of
from .paint_surface import LIGHT_SIZE, PaintSurface

SAMPLES = 8  # per pixel and axis, of the taps that light is fitted through
HIDDEN = 0.1  # coverage less than the vehicle's own by this: something stands before it
MEMORY_BYTES = 2**28


class PlaceLight:
    """Fits the light of a data set's places, or reads it."""

    def __init__(self, dataset: Dataset) -> None:
        """Raises :class:`RaucaError` for a data set without light maps."""
        require_light(dataset)
        self.dataset = dataset
        self.vehicle: Vehicle = load_vehicle(dataset.vehicle_folder, read_image)
        self.taps = TapCache(dataset.folder / "taps", self.vehicle, TapSettings(LIGHT_SIZE, SAMPLES), MEMORY_BYTES)
        self.surface = PaintSurface.of(self.vehicle, self.taps.pyramid, LIGHT_SIZE)
        self._read: tuple[tuple[int, str], Irradiance] | None = None

    def fit(self, frames: Sequence[Frame]) -> tuple[StoredLight, Irradiance]:
        """The light of one place and weather from all its frames.

        Raises:
            RaucaError: none of them shows enough of the paint, or a light map is damaged.
        """
        first, plan = frames[0], self.dataset.plan
        optics = optics_of(self.vehicle, plan.finish, first.weather)
        sources = [self._source(frame) for frame in frames]
        irradiance = fit_place(sources, self.surface, optics, first.weather)
        apart = None
        if len(sources) > 1:
            left_out = sorted(range(len(sources)), key=lambda i: len(sources[i].taps))[len(sources) // 2]
            others = sources[:left_out] + sources[left_out + 1 :]
            apart = held_out(fit_place(others, self.surface, optics, first.weather), sources[left_out]).display_db
        stored = StoredLight(
            first.location, first.weather.name, self.vehicle.atlas_id, LIGHT_SIZE, plan.finish,
            irradiance.seen, int((irradiance.weight < SEEN).sum()), apart, irradiance.residuals,
        )  # fmt: skip
        return stored, irradiance

    def read(self, location: int, weather: str) -> Irradiance:
        """The stored light of a place and weather; the one read last is kept.

        Raises:
            RaucaError: it was not fitted, or is damaged, or was fitted for another vehicle or finish.
        """
        if self._read is None or self._read[0] != (location, weather):
            folder = self.require(location, weather)
            again = f"run `rauca dataset light {self.dataset.folder}`"
            stored, texels, weight = load_irradiance(folder)
            wanted = (self.vehicle.atlas_id, LIGHT_SIZE, self.dataset.plan.finish)
            fits = (stored.atlas_id, stored.size, stored.finish) == wanted
            if not fits or len(weight) != len(self.surface.light.texels):
                raise RaucaError(f"{folder}: light of another vehicle, finish or version; remove it and {again}")
            found = next(w for w in self.dataset.plan.weathers if w.name == weather)
            optics = optics_of(self.vehicle, stored.finish, found)
            irradiance = Irradiance(self.surface, optics, found, texels, weight, stored.sources)
            self._read = (location, weather), irradiance
        return self._read[1]

    def require(self, location: int, weather: str) -> Path:
        """The folder of a place's light; raises :class:`RaucaError` when it was not fitted."""
        folder = irradiance_folder(self.dataset.folder, location, weather)
        if not folder.is_dir():
            raise RaucaError(f"{folder}: this light is not fitted yet; run `rauca dataset light {self.dataset.folder}`")
        return folder

    def light_of(self, frame: Frame) -> Light:
        """A frame's light maps, with A from the texture where its sources saw the paint, else as rendered."""
        light = load_exact(self.dataset, frame.id)
        irradiance = self.read(*frame.place_and_weather)
        taps = self.taps.get(frame.camera_in_vehicle)
        left = 1.0 - drops_of(self.dataset, frame).alpha.reshape(-1, 1)[taps.pixels]
        gain = irradiance.gain(taps, frame.camera_in_vehicle, frame.exposure_stops).numpy() * left
        A = light.A.reshape(-1, 3).copy()
        shown = self._shown(frame, taps)  # less than the vehicle's own coverage behind a pole or a parked car
        bare = (shown > 0) & (taps.alpha > 0) & (np.abs(shown - taps.alpha) < HIDDEN)
        told = (irradiance.known(taps).numpy() >= KNOWN) & bare
        A[taps.pixels[told]] = gain[told]
        return Light(A.reshape(light.A.shape), light.B)

    def _source(self, frame: Frame) -> Source:
        camera = frame.camera_in_vehicle
        taps = self.taps.get(camera)
        light = without_rain(load_exact(self.dataset, frame.id), drops_of(self.dataset, frame))
        A, B = (half.reshape(-1, 3)[taps.pixels] * 2.0**-frame.exposure_stops for half in (light.A, light.B))
        return Source(camera, taps, A, B, frame.exposure_stops, frame.id, self._shown(frame, taps))

    def _shown(self, frame: Frame, taps: Taps) -> NDArray[np.float32]:
        """Share (R,) of the taps' pixels that shows paint behind whatever stands before the vehicle."""
        paint = read_picture(self.dataset.frame_folder(frame.id) / "paint.png", self.dataset.plan.size, grey=True)
        return paint.numpy().reshape(-1)[taps.pixels] / np.float32(255)


def light_places(
    folder: Path, progress: Callable[[Progress], None] = lambda _: None
) -> Iterator[tuple[StoredLight, bool]]:
    """Fit and store the light of every place and weather of a data set; what was fitted from the same frames is kept.

    Yields:
        what is told of each, and whether it was fitted now.

    Raises:
        RaucaError: no data set, one without light maps or frames, with composed frames, or a damaged frame.
    """
    dataset = Dataset(folder)
    dataset.require_rendered("light is fitted to and judged by")
    places = PlaceLight(dataset)
    groups = by_place_and_weather(frame for frame in dataset.frames() if frame.box_xyxy is not None)
    if not groups:
        raise RaucaError(f"{folder}: no finished frame shows the vehicle; make the data set first")
    for done, ((location, weather), group) in enumerate(groups.items()):
        progress(Progress(done, len(groups), f"L{location:02d} {weather}"))
        target = irradiance_folder(dataset.folder, location, weather)
        found = _kept(target, [frame.id for frame in group])
        if found is not None:
            yield found, False
            continue
        stored, irradiance = places.fit(group)
        save_irradiance(target, stored, irradiance.texels, irradiance.weight)
        yield stored, True
    progress(Progress(len(groups), len(groups), ""))


def _kept(folder: Path, frames: Sequence[str]) -> StoredLight | None:
    try:
        stored, _, _ = load_irradiance(folder)
    except RaucaError:
        return None
    return stored if [source.frame for source in stored.sources] == list(frames) else None
