"""The gain of the paint in new views, from the irradiance textures of a data set (`rauca dataset light`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...contract import Camera, Dataset
from ...contract.irradiance import irradiance_folder
from ...render import Pyramid, Taps, TapSettings
from ..irradiance import Irradiance
from ..paint_surface import LIGHT_SIZE, PaintSurface
from ..place_light import PlaceLight

SAMPLES = 2  # per pixel and axis of taps built for their light alone: 4 gain .2 dB in the paint, for 100 ms more


class PaintLight:
    """The irradiance textures of a data set, for taps of one pyramid."""

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
