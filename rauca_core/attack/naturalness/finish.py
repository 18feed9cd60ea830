"""The finished map in 8 bits, still within every constraint, and what it turned out to be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...contract import Vehicle
from ...contract.color import to_bytes
from ...render import Pyramid, linear_to_srgb, srgb_to_linear
from .bound import distances, round_within
from .choice import Naturalness
from .lab import delta_e_2000, lab
from .palette import palette_bytes
from .reference import reference_texels
from .texture import Constraints

GUTTER = 8  # texels beside the paint that a renderer's filter may read


@dataclass(frozen=True)
class Distance:
    """How far paint is from a reference; means are over the vehicle's surface.

    Attributes:
        mean, largest: of the CIE 1976 distance; mean_2000: of CIEDE2000.
    """

    mean: float
    largest: float
    mean_2000: float

    @staticmethod
    def of(texels: NDArray[np.uint8], reference: NDArray[np.uint8], areas: NDArray[np.float64]) -> Distance:
        """Of 8-bit sRGB texels (P, 3) from others, weighted by their areas (P,)."""
        one, other = (lab(torch.from_numpy(t / 255.0)).numpy() for t in (texels, reference))
        apart = np.linalg.norm(one - other, axis=1)
        mean, mean_2000 = (float(np.average(d, weights=areas)) for d in (apart, delta_e_2000(one, other)))
        return Distance(mean, float(apart.max()), mean_2000)


def finish(constraints: Constraints, texels_srgb: Tensor) -> tuple[NDArray[np.uint8], dict[str, Any]]:
    """The UV map (size, size, 3), 8-bit sRGB, and what is to be remembered about it.

    Gutters are filled from their neighbors; of a palette or patches they hold no color of their own.

    Args:
        texels_srgb: (P, 3), what the optimization ended with.
    """
    wanted = constraints.wanted
    texels = to_bytes(texels_srgb.detach().cpu().numpy())
    if wanted.max_delta_e is not None and not wanted.palette and constraints.home is not None:
        patches = constraints.patches
        home = constraints.home if patches is None else constraints.home[patches.of_texel]
        texels = round_within(texels_srgb.detach().cpu().numpy(), home, wanted.max_delta_e)
    facts: dict[str, Any] = {"paint_m2": round(float(constraints.points.areas.sum()), 4)}
    if constraints.patches is not None:
        facts["patches"] = constraints.patches.count
    if constraints.reference is not None:
        distance = Distance.of(texels, constraints.reference, constraints.points.areas)
        facts |= {"mean_delta_e": distance.mean, "mean_delta_e_2000": distance.mean_2000}
        facts["largest_delta_e"] = distance.largest
        if constraints.patches is not None and constraints.home is not None:
            home = constraints.home[constraints.patches.of_texel]
            facts["largest_delta_e_of_a_patch"] = float(distances(texels / 255.0, home / 255.0).max())
    return _fill(constraints.atlas, texels, wanted), facts


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


def distance_of_map(vehicle: Vehicle, uv_map: NDArray[np.uint8], wanted: Naturalness) -> Distance:
    """How far any UV map (size, size, 3) is from the reference of ``wanted``, on its paintable texels."""
    from .surface import TexelPoints

    atlas = Pyramid.of(vehicle, len(uv_map))
    texels = uv_map.reshape(-1, 3)[atlas.texels]
    return Distance.of(texels, reference_texels(vehicle, atlas, wanted), TexelPoints.of(vehicle, atlas).areas)
