"""``--views dense``: at every step new cameras in the rendered places, composed while the step before works."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import torch

from ..contract import Dataset, RaucaError
from ..contract.color import linear_to_srgb, to_bytes
from ..environment.views import Views
from .frames import FrameStore, ReadyFrame
from .settings import OptimizerSettings

DENSE = 32_768
"""Views of a run before one comes again: as many as the paper's frames."""
SAMPLES = 3  # per pixel and axis, at most: a view is seen once, and its taps cost the more the finer they are
TRIES = 64  # neighbors asked in place of a view that shows nothing of the vehicle


class DrawnStore(FrameStore):
    """New cameras in the places of a data set; each is composed when it is asked for, and not kept.

    View i is a function of the data set, the seed and i: a resumed run, or another process, sees the same.
    """

    def __init__(self, dataset: Dataset, settings: OptimizerSettings, device: torch.device | str = "cpu") -> None:
        """Raises :class:`RaucaError` as :class:`FrameStore` and :class:`Views` do, and for light that is estimated.

        The paint's light is that of the irradiance textures that there are; ``irradiance`` wants all of them.
        """
        if settings.light not in ("exact", "irradiance"):
            raise RaucaError(
                f"light: {settings.light} is of rendered frames; drawn views bring their own, drop --light"
            )
        super().__init__(dataset, settings, device)
        self._on_map = settings.paint == "texels"  # what taps of facets and patterns read is no map of light
        pyramid = self.pyramid if self._on_map else None
        self.views = Views(dataset, DENSE, seed=settings.seed, memory_mb=settings.memory_mb // 2, pyramid=pyramid)
        taps: Any = self.layout.taps.settings
        self._recipe = replace(taps, samples=min(taps.samples, SAMPLES))

    def __len__(self) -> int:
        return len(self.views)

    def ready(self, index: int) -> ReadyFrame:
        """The view at ``index``, or the next one that shows the vehicle; raises :class:`RaucaError` if none does."""
        for place in range(index, index + TRIES):
            view = place % len(self.views)
            taps = self._recipe.build(self.vehicle, self.views.camera_in_vehicle(view), self.layout.taps.pyramid)
            made = self.views.lit_through(view, taps if self._on_map else None)
            if made.frame.box_xyxy is None or made.frame.visible < self.views.plan.min_visible:
                continue
            passes = made.passes
            assert passes.A is not None
            assert passes.B is not None
            A, B = (torch.from_numpy(m.reshape(-1, 3)[taps.pixels]) for m in (passes.A, passes.B))
            picture = to_bytes(linear_to_srgb(passes.image_linear)).reshape(-1, 3)
            return ReadyFrame(made.frame, taps, A, B, picture)
        told = f"{self.views.dataset.folder}: {TRIES} drawn views in a row show nothing of the vehicle"
        raise RaucaError(f"{told}; make a data set whose places are less hidden")

    @contextlib.contextmanager
    def warming(self, order: Sequence[int], on_view: Callable[[int, int], None] | None = None) -> Iterator[None]:
        """Nothing to build beforehand: no camera comes twice."""
        yield


def frame_store(dataset: Dataset, settings: OptimizerSettings, device: torch.device | str = "cpu") -> FrameStore:
    """The frames that ``settings.views`` asks for; raises :class:`RaucaError` as they do."""
    kind = DrawnStore if settings.views == "dense" else FrameStore
    return kind(dataset, settings, device)
