"""The renderers that are compared, and the scenes in which they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.contract import Camera, Vehicle
from rauca_core.render import MipmappedTexture, Pyramid, Taps, build_taps
from rauca_core.render.sampler import Sampler

from .harness import Clock, Settings, psnr_db
from .render_agreement import premultiplied
from .render_reference import TEXTURES, RayCaster, Reference, render_reference, ring, uv_map

ALGORITHM_2 = "Algorithm 2, 2x2"
BILINEAR = "1 bilinear sample"


@dataclass(frozen=True)
class Renderer:
    """How texels are looked up, and how many subsamples a pixel has along each axis."""

    name: str
    sampler: Sampler
    samples: int

    def taps(self, vehicle: Vehicle, camera: Camera, pyramid: Pyramid) -> Taps:
        # With the box filter, which is the reference's.
        return build_taps(vehicle, camera, pyramid.size, self.samples, "box", pyramid=pyramid, sampler=self.sampler)


def ours(samples: int) -> Renderer:
    return Renderer(f"ours {samples}x{samples}", Sampler.AREA, samples)


PUBLISHED = (Renderer("Algorithm 1, 2x2", Sampler.TENSOR_TRAVERSAL, 2), Renderer(ALGORITHM_2, Sampler.UV_TRAVERSAL, 2))
SIMPLE = (Renderer(BILINEAR, Sampler.BILINEAR, 1), Renderer("1 trilinear sample", Sampler.TRILINEAR, 1))


def renderers(samples: Sequence[int]) -> list[Renderer]:
    """Of the literature, as published at 2x2, and ours at each of ``samples``."""
    return [*SIMPLE, *PUBLISHED, *(ours(n) for n in samples)]


@dataclass(frozen=True, eq=False)
class Car:
    """A vehicle and what is prepared for it once: by texture its map (K, size, size, 3) and all mip levels, linear."""

    name: str
    vehicle: Vehicle
    pyramid: Pyramid
    caster: RayCaster
    maps: NDArray[np.float32]
    texels: list[Tensor]

    @staticmethod
    def of(name: str, vehicle: Vehicle, uv_size: int) -> Car:
        """Raises :class:`RaucaError` where Embree is missing."""
        caster, pyramid = RayCaster(vehicle), Pyramid.of(vehicle, uv_size)
        maps = np.stack([uv_map(kind, pyramid) for kind in TEXTURES])
        texels = [pyramid(pyramid.from_map(torch.from_numpy(m).permute(2, 0, 1))) for m in maps]
        return Car(name, vehicle, pyramid, caster, maps, texels)

    def texture(self) -> MipmappedTexture:
        return MipmappedTexture(self.pyramid, self.texels[0][: len(self.pyramid.texels)].clone().requires_grad_())


@dataclass(frozen=True, eq=False)
class Scene:
    """A ring of cameras around a car, and the reference of each view."""

    car: Car
    ring: str
    size: int
    cameras: list[Camera]
    references: list[Reference]

    @staticmethod
    def of(car: Car, ring_name: str, size: int, settings: Settings, moved: Callable[[], None]) -> Scene:
        cameras, references = ring(car.vehicle, ring_name, settings.views[ring_name], size), []
        for camera in cameras:
            references.append(render_reference(car.vehicle, car.caster, camera, car.maps, settings.reference_samples))
            moved()
        return Scene(car, ring_name, size, cameras, references)

    def psnr_db(self, views: Sequence[Taps], texture: int) -> float:
        """PSNR over all pixels of all views that show paint."""
        errors = []
        for view, reference in zip(views, self.references, strict=True):
            image = premultiplied(view, self.car.texels[texture])
            shown = (reference.coverage > 0) | (image > 0).any(2)
            errors.append(np.asarray((image[shown] - reference.colors[texture][shown]) ** 2, np.float64))
        return psnr_db(np.concatenate(errors))


def painted_all_over(vehicle: Vehicle) -> Vehicle | None:
    """The vehicle with every face painted, as the published renderer textures it; None without an atlas for that."""
    a, b, c = vehicle.uvs.astype(np.float64).transpose(1, 0, 2)
    (ux, uy), (vx, vy) = (b - a).T, (c - a).T
    unwrapped = np.abs(ux * vy - uy * vx) > 0
    if unwrapped.mean() < 0.9:
        return None
    materials = [replace(material, kind="paint") for material in vehicle.materials]
    return replace(vehicle, materials=materials, paint_mask=np.full_like(vehicle.paint_mask, 255))


def touched_texels(pyramid: Pyramid, touched: Sequence[NDArray[np.bool_]]) -> NDArray[np.bool_]:
    """(P,) which of the pyramid's paintable texels any subsample of the references weighs."""
    return np.asarray(np.any(touched, 0).ravel()[pyramid.texels])


def reached_texels(pyramid: Pyramid, views: Sequence[Taps]) -> NDArray[np.bool_]:
    """(P,) which texels receive gradient when every pixel asks for more light, over all views."""
    texels = torch.zeros(len(pyramid.texels), 3, requires_grad=True)
    levels = pyramid(texels)
    # Every weight is positive, so nothing cancels: zero gradient means out of reach.
    asked = sum((view.rows(levels).sum() for view in views), levels.new_zeros(()))
    (gradient,) = torch.autograd.grad(asked, texels)
    return gradient[:, 0].numpy() > 0


def timed_step(views: Sequence[Taps], texture: MipmappedTexture, clock: Clock) -> Tensor:
    """Laps of forward and backward; returns the gradient that is left to take down the mip levels."""
    operators = [view.rows for view in views]
    clock.restart()
    pixels = texture.sample(operators)
    clock.lap()
    asked = torch.ones_like(pixels)
    clock.restart()
    (gradient,) = torch.autograd.grad(pixels, texture.ticket, asked)
    clock.lap()
    return gradient
