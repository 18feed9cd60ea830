"""The same loop with the paper's Algorithm 2 in place of taps: T_fc is filled from the UV map at every step."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.render.published import pixels_from_cells
from rauca_core.attack.frames import ReadyFrame, shade
from rauca_core.attack.run import Run
from rauca_core.attack.stopwatch import Stopwatch
from rauca_core.render import SparseOperator, srgb_to_linear
from rauca_core.render.sampling.facet_steps import texel_faces, uv_traversal_step, uv_traversal_step_back
from rauca_core.render.sampling.sampler import TEXTURE_SIZE


class Algorithm2Run(Run):
    """A run whose frames read the facet texture tensor; everything else is shared with :class:`Run`.

    As published, a pixel has 2 x 2 subsamples. Which face every texel and pixel belongs to is looked up once, where the
    published renderer finds it again at every step.
    """

    def prepare(self) -> None:
        """Find what depends on geometry alone, outside the steps that are timed."""
        vehicle = self.store.vehicle
        uvs = vehicle.uvs[vehicle.paint_faces()].astype(np.float64)
        self._facets = _Facets(uvs, texel_faces(uvs, self.settings.map_size))
        self._views: dict[str, ReadyFrame] = {}
        for i in range(len(self.store)):
            self._view(self.store.ready(i))

    def _render(self, batch: list[ReadyFrame], watch: Stopwatch) -> Tensor:
        with watch.time("taps"):
            frames = [self._view(frame) for frame in batch]
            uv_map = self._uv_map(srgb_to_linear(self.texture.texels()))
            cells = _Fill.apply(uv_map, self._facets)
            albedo = torch.cat([frame.taps.rows(cells) for frame in frames])
        with watch.time("environment"):
            return shade(frames, albedo)

    def _uv_map(self, texels: Tensor) -> Tensor:
        size = self.settings.map_size
        flat = texels.new_zeros(size**2, 3)
        return flat.index_copy(0, torch.from_numpy(self.store.pyramid.texels), texels).reshape(size, size, 3)

    def _view(self, frame: ReadyFrame) -> ReadyFrame:
        """The frame, its light at the pixels that Algorithm 2 covers."""
        if frame.frame.id not in self._views:
            pixels, rows = pixels_from_cells(self.store.vehicle, frame.frame.camera_in_vehicle)
            light = self.store.light.of(frame.frame).light
            A, B = (torch.from_numpy(m.reshape(-1, 3)[pixels]) for m in (light.A, light.B))
            taps = _Cells(rows, pixels, frame.taps.width, frame.taps.height)
            self._views[frame.frame.id] = replace(frame, taps=taps, A=A, B=B)  # type: ignore[arg-type]
        return self._views[frame.frame.id]


@dataclass(frozen=True, eq=False)
class _Cells:
    """Stands where taps do: rows read cells, not texels."""

    rows: SparseOperator
    pixels: Any
    width: int
    height: int


@dataclass(frozen=True, eq=False)
class _Facets:
    uvs: Any
    faces: Any


class _Fill(torch.autograd.Function):
    """A map (size, size, 3) -> all cells of T_fc (nf * ts ** 3, 3)."""

    @staticmethod
    def forward(ctx: Any, uv_map: Tensor, facets: _Facets) -> Tensor:
        cells, total = uv_traversal_step(uv_map.detach().numpy(), facets.uvs, facets.faces, TEXTURE_SIZE)
        ctx.facets, ctx.total = facets, total
        return torch.from_numpy(cells).reshape(-1, 3)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        given = gradients[0].contiguous().numpy().reshape(*ctx.total.shape, 3)
        return torch.from_numpy(uv_traversal_step_back(given, ctx.total, ctx.facets.uvs, ctx.facets.faces)), None
