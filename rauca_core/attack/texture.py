"""What an optimization varies, and three ways to keep it in [0, 1] while Adam moves it.

``project`` puts them back after each step; every texel keeps its gradient. ``clamp`` clips in the forward pass, as
published; a texel beyond the range has no gradient and can only be brought back by Adam's momentum. ``tanh`` never
leaves the range, and slows down near its ends.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..contract import RaucaError, load_camouflage
from ..contract.color import to_bytes
from ..contract.seeding import named_seed
from ..render import saturate
from ..render.uv_map import read_uv_map
from .das import seed_paint
from .frames import FrameStore
from .layout import PaintLayout
from .naturalness.texture import Constraints, NaturalColors
from .settings import OptimizerSettings

FURTHEST = 0.98  # of tanh's range that a start may take: at its ends there is no way back


@dataclass(frozen=True)
class Limit:
    """Between a free parameter and sRGB values in [0, 1], of any shape.

    Attributes:
        start: values -> the parameter that stands for them.
        values: parameter -> sRGB values in [0, 1], differentiable.
        after_step: mends the parameter in place, after a step.
    """

    start: Callable[[Tensor], Tensor]
    values: Callable[[Tensor], Tensor]
    after_step: Callable[[Tensor], object]


LIMITS: dict[str, Limit] = {
    # Clipped as `saturate` does it, a texel at the very end still has its gradient.
    "project": Limit(torch.clone, saturate, lambda parameter: parameter.detach().clamp_(0.0, 1.0)),
    "clamp": Limit(torch.clone, saturate, lambda parameter: None),
    "tanh": Limit(
        lambda values: torch.atanh((2 * values - 1) * FURTHEST),
        lambda parameter: (parameter.tanh() + 1) / 2,
        lambda parameter: None,
    ),
}
GREY = 0.5
# Starts of what tanh is taken of, from values uniform in [0, 1].
TANH_STARTS: dict[str, Callable[[Tensor], Tensor]] = {"tanh-unit": torch.clone, "tanh-wide": lambda u: 6 * u - 3}


class FreeColors:
    """Every color of the layout is free; on the UV map that is RAUCA's texture.

    Attributes:
        parameter: the leaf that Adam moves; its shape is the texture's own business.
    """

    def __init__(self, layout: PaintLayout, settings: OptimizerSettings, first: Tensor) -> None:
        """``first`` (M, 3) sRGB: what is free begins with it, on its device; for `TANH_STARTS` uniform in [0, 1]."""
        self._limit, self._layout = LIMITS[settings.limit], layout
        self.parameter = TANH_STARTS.get(settings.start, self._limit.start)(first).requires_grad_()

    def free(self) -> Tensor:
        """What is free, (M, 3) sRGB in [0, 1], a differentiable function of ``parameter``."""
        return self._limit.values(self.parameter)

    def colors(self) -> Tensor:
        """What views read: the layout's colors (N, 3), sRGB in [0, 1], differentiable."""
        return self.free()

    def texels(self) -> Tensor:
        """The same on the UV map: its paintable texels (P, 3)."""
        return self._layout.on_map(self.colors())

    def after_step(self) -> None:
        """Mend ``parameter`` after a step of Adam."""
        self._limit.after_step(self.parameter)


class PaintedPanels(FreeColors):
    """Some panels of the body are painted, over a seed picture; the rest keeps the reference paint.

    Attributes:
        seed: (M, 3) sRGB, the seed picture at the free cells.
        edges: (M,) float32, 1 on the seed picture's lines.
    """

    def __init__(self, store: FrameStore, settings: OptimizerSettings, device: torch.device) -> None:
        """Raises :class:`RaucaError` where no face of the paint looks like a bonnet, roof or door."""
        cells, seed, edges = seed_paint(store.vehicle, store.reference_srgb, settings.texture_size)
        self.seed, self.edges, self._cells = (torch.from_numpy(a).to(device) for a in (seed, edges, cells))
        reference = torch.from_numpy(np.array(store.reference_srgb, np.float32) / 255)
        self._base = reference.expand(store.layout.count, 3).clone().to(device)
        first = self.seed if settings.start == "seed" else first_colors(len(cells), settings).to(device)
        super().__init__(store.layout, settings, first)

    def colors(self) -> Tensor:
        return self._base.index_copy(0, self._cells, self.free())


Texture = FreeColors | NaturalColors


def make_texture(store: FrameStore, settings: OptimizerSettings, device: torch.device) -> Texture:
    """The texture of a run, on ``device``; raises :class:`RaucaError` for settings that do not fit together."""
    if settings.start in TANH_STARTS and settings.limit != "tanh":
        raise RaucaError(
            f"--start {settings.start}: is of --limit tanh, not {settings.limit}; choose another of the two"
        )
    if settings.natural is not None:
        for name, value, needed in (("paint", settings.paint, "texels"), ("cover", settings.cover, "all")):
            if value != needed:
                raise RaucaError(f"{name}: a natural camouflage is made of {needed}, not {value}; drop one of the two")
        if settings.limit != "project":
            raise RaucaError(f"--limit {settings.limit}: natural camouflage is kept in range by project; choose that")
        constraints = Constraints(store.vehicle, store.pyramid, settings.natural, settings.seed)
        if settings.begin_with is not None:
            given = constraints.of_patches(to_bytes(_given_texels(store, settings.begin_with).numpy()))
            return NaturalColors(constraints, torch.from_numpy(given.astype(np.float32) / 255).to(device))
        if constraints.home is None or settings.natural.max_delta_e is None:
            return NaturalColors(constraints, first_colors(constraints.count, settings).to(device))
        # Noise of a random start would stay, as loud as the bound allows, wherever no view says otherwise.
        return NaturalColors(constraints, torch.from_numpy(constraints.home.astype(np.float32) / 255).to(device))
    if settings.begin_with is not None:
        if settings.paint != "texels":
            raise RaucaError(f"{settings.begin_with}: a camouflage to begin with is of texels, not {settings.paint}")
        return FreeColors(store.layout, settings, _given_texels(store, settings.begin_with).to(device))
    if settings.cover == "panels":
        if settings.paint != "facets":
            raise RaucaError(f"cover: panels are painted on facets, not on {settings.paint}; choose cover: all")
        return PaintedPanels(store, settings, device)
    if settings.start == "seed":
        raise RaucaError("start: the seed picture is for cover: panels; choose random or plain")
    return FreeColors(store.layout, settings, first_colors(store.layout.count, settings).to(device))


def _given_texels(store: FrameStore, path: Path) -> Tensor:
    """(P, 3) sRGB: the paintable texels of a camouflage; raises :class:`RaucaError` where it is another vehicle's."""
    record, image = load_camouflage(path)
    record.check_fits(store.vehicle.atlas_id, str(path))
    pixels = read_uv_map(image, store.pyramid.size).transpose(2, 0, 1)
    return store.pyramid.from_map(torch.from_numpy(pixels.astype(np.float32) / 255))


def first_colors(count: int, settings: OptimizerSettings) -> Tensor:
    """Where an optimization begins: (count, 3) sRGB, drawn on the CPU: the same whatever the device."""
    if settings.start == "plain":
        return torch.full((count, 3), GREY)
    generator = torch.Generator().manual_seed(named_seed(settings.seed, "start"))
    return torch.rand(count, 3, generator=generator)
