"""The texture of an optimization whose camouflage has to look natural, and its finished map in 8 bits."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...contract import RaucaError, Vehicle, color
from ...contract.color import to_bytes
from ...render import Pyramid, SparseOperator, linear_to_srgb, saturate, srgb_to_linear
from . import Naturalness
from .colors import distances, draw_back, round_within
from .palette import Palette, palette_bytes
from .patches import Patches, TexelPoints, link, make_patches, mirrored
from .reference import Distance, reference_texels

GUTTER = 8  # texels beside the paint that a renderer's filter may read


class Constraints:
    """What a camouflage has to keep to, worked out for one vehicle at one size of map.

    Attributes:
        points: of the texels on the vehicle.
        patches: of one color each; None where every texel is free.
        reference: (P, 3) 8-bit sRGB at the texels, or None.
        home: (M, 3) 8-bit sRGB, the reference of each patch: the mean of its light.
        palette: or None.
        bound: how far free colors may be from home. With a palette the bound is on the colors chosen, see ``allowed``:
            the way from one to another stays open.
        allowed: (M, K) which palette colors the bound leaves to each patch; None where there is none or no bound.
    """

    def __init__(self, vehicle: Vehicle, atlas: Pyramid, wanted: Naturalness, seed: int) -> None:
        """Raises :class:`RaucaError` for a reference that does not fit, or a palette too far from it."""
        self.wanted, self.atlas = wanted, atlas
        self.points = TexelPoints.of(vehicle, atlas)
        self.patches: Patches | None = None
        if wanted.feature_cm is not None:
            links = link(self.points, atlas.texels, atlas.size)
            self.patches = make_patches(self.points, links, wanted.feature_cm / 100, seed)
        if wanted.symmetric:
            every = np.arange(len(atlas.texels))
            self.patches = mirrored(self.patches or Patches(every.astype(np.int32), every), self.points)
        self.palette = Palette(wanted.palette) if wanted.palette else None
        self.bound = wanted.max_delta_e if self.palette is None else None
        self.reference = None if wanted.reference is None else reference_texels(vehicle, atlas, wanted)
        self.home = None if self.reference is None else self.of_patches(self.reference)
        self.allowed = self._allowed()

    @property
    def count(self) -> int:
        """M, how many colors are free: one a patch, or one a texel."""
        return len(self.atlas.texels) if self.patches is None else self.patches.count

    @property
    def home_of_texels(self) -> NDArray[np.uint8]:
        """``home`` of each texel's patch, (P, 3)."""
        assert self.home is not None
        return self.home if self.patches is None else self.home[self.patches.of_texel]

    def after_step(self, free: Tensor) -> None:
        """Bring free colors (M, 3) sRGB back to where they may be, in place."""
        with torch.no_grad():
            free.clamp_(0.0, 1.0)
            if self.bound is not None and self.home is not None:
                near = free.cpu()  # on the CPU this is ``free`` itself
                draw_back(near.numpy(), self.home.astype(np.float32) / 255, self.bound)
                free.copy_(near)

    def of_patches(self, texels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """(M, 3) 8-bit sRGB: the mean of the light of each patch's texels (P, 3)."""
        if self.patches is None:
            return texels
        light = color.srgb_to_linear(texels / 255.0) * self.points.areas[:, None]
        weight = np.bincount(self.patches.of_texel, self.points.areas, self.count)
        sums = [np.bincount(self.patches.of_texel, column, self.count) for column in light.T]
        return to_bytes(color.linear_to_srgb(np.stack(sums, 1) / np.maximum(weight, 1e-30)[:, None]))

    def _allowed(self) -> Tensor | None:
        bound = self.wanted.max_delta_e
        if bound is None or self.palette is None or self.home is None:
            return None
        home = self.home / 255.0
        apart = np.stack(
            [distances(np.tile(one, (len(home), 1)), home) for one in self.palette.colors.double().numpy()], 1
        )
        near = apart <= bound
        if not near.any(1).all():
            lost, best = 1 - near.any(1).mean(), math.ceil(apart.min(1).max() * 10) / 10
            raise RaucaError(
                f"--max-delta-e {bound:g}: on {lost:.0%} of the paint no color of the palette is that near the "
                f"reference; allow {best:.1f} or give more --palette colors"
            )
        return torch.from_numpy(near)


class NaturalColors:
    """One color per patch, or per texel; seen as the nearest of the palette, never too far from the reference.

    Attributes:
        parameter: (M, 3) sRGB.
        constraints: what it keeps to.
    """

    def __init__(self, constraints: Constraints, first: Tensor) -> None:
        """``first`` (M, 3) sRGB: where to begin; it is brought to where it may be."""
        self.constraints = constraints
        start = first.clone()
        constraints.after_step(start)
        self.parameter = start.requires_grad_()
        allowed, patches, self._spread = constraints.allowed, constraints.patches, None
        self._allowed = None if allowed is None else allowed.to(first.device)
        if patches is not None:
            ones = np.ones(len(patches.of_texel), np.float32)
            indptr = np.arange(len(ones) + 1, dtype=np.int64)
            self._spread = SparseOperator(indptr, patches.of_texel, ones, patches.count)

    def colors(self) -> Tensor:
        free, palette = saturate(self.parameter), self.constraints.palette
        seen = free if palette is None else palette.hard(free, self._allowed)
        return seen if self._spread is None else self._spread(seen)

    def texels(self) -> Tensor:
        return self.colors()

    def after_step(self) -> None:
        self.constraints.after_step(self.parameter)


def finish(constraints: Constraints, texels_srgb: Tensor) -> tuple[NDArray[np.uint8], dict[str, Any]]:
    """The UV map (size, size, 3), 8-bit sRGB, and what is to be remembered about it.

    Gutters are filled from their neighbors; of a palette or patches they hold no color of their own.

    Args:
        texels_srgb: (P, 3), what the optimization ended with.
    """
    free = texels_srgb.detach().cpu().numpy()
    if constraints.bound is None:
        texels = to_bytes(free)
    else:
        texels = round_within(free, constraints.home_of_texels, constraints.bound)
    facts: dict[str, Any] = {"paint_m2": round(float(constraints.points.areas.sum()), 4)}
    if constraints.patches is not None:
        facts["patches"] = constraints.patches.count
    if constraints.reference is not None:
        distance = Distance.of(texels, constraints.reference, constraints.points.areas)
        facts |= {"mean_delta_e": distance.mean, "mean_delta_e_2000": distance.mean_2000}
        facts["largest_delta_e"] = distance.largest
        if constraints.patches is not None:
            apart = distances(texels / 255.0, constraints.home_of_texels / 255.0)
            facts["largest_delta_e_of_a_patch"] = float(apart.max())
    return _fill(constraints.atlas, texels, constraints.wanted), facts


def _fill(atlas: Pyramid, texels: NDArray[np.uint8], wanted: Naturalness) -> NDArray[np.uint8]:
    """The whole map: far from paint a mean of what is near, beside it no color that the paint does not have."""
    light = srgb_to_linear(torch.from_numpy(texels.astype(np.float32) / 255))
    uv_map = to_bytes(linear_to_srgb(atlas.to_map(light)).permute(1, 2, 0).numpy())
    flat = uv_map.reshape(-1, 3)
    if wanted.palette:
        few, place = np.unique(flat, axis=0, return_inverse=True)
        colors = palette_bytes(wanted.palette)
        apart = ((few[:, None].astype(int) - colors[None].astype(int)) ** 2).sum(-1)
        flat[:] = colors[apart.argmin(1)][place.ravel()]
    flat[atlas.texels] = texels  # to the bit, whatever a round trip through light does to them
    if wanted.palette or wanted.feature_cm is not None:
        known = atlas.coverage[0] > 0
        for _ in range(GUTTER):
            known = _copy_outwards(uv_map, known)
    return uv_map


def _copy_outwards(uv_map: NDArray[np.uint8], known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Give texels beside ``known`` ones a neighbor's color, in place; returns what is known then."""
    grown = known.copy()
    for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
        here = np.roll(known, step, axis) & ~grown
        here[(slice(None),) * axis + (0 if step == 1 else -1,)] = False  # what came in from the other side
        uv_map[here] = np.roll(uv_map, step, axis)[here]
        grown |= here
    return grown
