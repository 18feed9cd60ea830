"""What everything is measured on: one vehicle, one ring, one image size, and what its pixels ought to show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.contract import Camera, Vehicle
from rauca_core.render import MipmappedTexture, Pyramid

from .embree import RayCaster
from .reference import Reference, embree_sees, render_reference
from .settings import Settings
from .textures import TEXTURES, uv_map
from .views import ring


@dataclass(frozen=True, eq=False)
class Car:
    """A vehicle and what is prepared for it once.

    Attributes:
        maps: (K, size, size, 3) the textures, linear.
        texels: per texture all mip levels (T, 3) of the map, linear.
    """

    name: str
    vehicle: Vehicle
    pyramid: Pyramid
    caster: RayCaster
    maps: NDArray[np.float32]
    texels: list[Tensor]

    def texture(self) -> MipmappedTexture:
        """The first texture, that asks for gradients."""
        return MipmappedTexture(self.pyramid, self.texels[0][: len(self.pyramid.texels)].clone().requires_grad_())


@dataclass(frozen=True, eq=False)
class Scene:
    """A ring of cameras around a car, and the reference of each view."""

    car: Car
    ring: str
    size: int
    cameras: list[Camera]
    references: list[Reference]

    @property
    def title(self) -> str:
        return f"{self.car.name}, {self.ring} ring, {self.size} px"


def prepare_car(name: str, vehicle: Vehicle, settings: Settings) -> Car:
    """Pyramid, ray caster and textures of a vehicle.

    Raises:
        RaucaError: Embree is missing.
    """
    caster = RayCaster(vehicle)
    pyramid = Pyramid.of(vehicle, settings.uv_size)
    maps = np.stack([uv_map(kind, pyramid) for kind in TEXTURES])
    texels = [pyramid(pyramid.from_map(torch.from_numpy(m).permute(2, 0, 1))) for m in maps]
    return Car(name, vehicle, pyramid, caster, maps, texels)


def prepare_scene(car: Car, ring_name: str, size: int, settings: Settings, moved: Callable[[], None]) -> Scene:
    """Render the references of a ring; ``moved`` is called after each view."""
    number = settings.paper_views if ring_name == "paper" else settings.close_views
    cameras = ring(car.vehicle, ring_name, number, size)
    references = []
    for camera in cameras:
        see = embree_sees(car.caster, camera)
        references.append(render_reference(car.vehicle, see, camera, car.maps, settings.reference_samples))
        moved()
    return Scene(car, ring_name, size, cameras, references)
