"""What a finish lets out of the light that the painted layer scatters, by the angle at which it is seen.

A Principled BSDF weighs its diffuse layer by what the layers above it, seen from the camera, do not reflect: the
lacquer by Fresnel's equations, a rough dielectric by its albedo in that direction, energy-preserving GGX (Walter et al.
2007; Heitz 2018 for visible normals; Kulla and Conty 2017 for what bounces again). Nothing else of the paint depends on
the camera. Against Blender's own white furnace this is within 0.01 for every finish (`tests/environment`).
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..contract import Finish
from ..contract.finish import COAT_IOR, FILM_ROUGHNESS, WALL_SHARE

Array = NDArray[np.float64]

COSINES = np.linspace(0.01, 1.0, 67)
HEMISPHERE = np.ones(len(COSINES))  # weights of the trapezoidal rule
HEMISPHERE[[0, -1]] = 0.5
FILMS = np.linspace(0.0, 1.0, 5)
SIDE = 32  # squared: directions of microfacets


class PaintOptics:
    """The angular factor of a finish, dry or wet."""

    def __init__(self, finish: Finish, film: float = 0.0) -> None:
        """``film``: water on the surface, 0 to 1, see `Weather.film`."""
        self._film = film
        shares = FILMS if film > 0 else FILMS[:1]
        smooth = min(finish.roughness, FILM_ROUGHNESS)
        wetted = [replace(finish, roughness=finish.roughness + s * (smooth - finish.roughness)) for s in shares]
        self._table = np.stack([_let_out(each) for each in wetted])

    def __call__(self, cosine: Array, up: Array) -> Array:
        """Share (N,) in (0, 1] of scattered light that leaves the paint towards the camera.

        Args:
            cosine: (N,) between smooth normal and direction to the camera; below 0.01 counts as that.
            up: (N,) the normal's z, which says how wet a face gets.
        """
        place = np.clip((cosine - COSINES[0]) / (COSINES[1] - COSINES[0]), 0, len(COSINES) - 1.000001)
        column = place.astype(np.int64)
        right = place - column
        film = self._film * np.clip(WALL_SHARE + (1 - WALL_SHARE) * up, 0, 1) * (len(self._table) - 1)
        row = np.minimum(film.astype(np.int64), max(len(self._table) - 2, 0))
        below = film - row
        last = np.minimum(row + 1, len(self._table) - 1)
        dry, wet = (self._table[r, column] * (1 - right) + self._table[r, column + 1] * right for r in (row, last))
        return dry * (1 - below) + wet * below


def fresnel(cosine: Array, ior: float) -> Array:
    """Reflectance of unpolarized light at a dielectric, seen from outside."""
    g = np.sqrt(ior * ior - 1 + cosine * cosine)
    return (
        0.5
        * ((g - cosine) / (g + cosine)) ** 2
        * (1 + ((cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)) ** 2)
    )


@functools.lru_cache(64)
def _let_out(finish: Finish) -> Array:
    """By :data:`COSINES`."""
    out = 1 - finish.coat * fresnel(COSINES, COAT_IOR)
    if finish.specular <= 0:
        return out
    head_on = np.sqrt(min(0.08 * finish.specular, 0.9))
    ior = (1 + head_on) / (1 - head_on)
    reflected, energy = (
        np.array(column) for column in zip(*(_lobe(c, finish.roughness, ior) for c in COSINES), strict=True)
    )

    def everywhere(values: Array) -> float:
        return float(2 * np.average(values * COSINES, weights=HEMISPHERE))

    once, kept = everywhere(fresnel(COSINES, ior)), everywhere(energy)
    again = once * kept / (1 - once * (1 - kept))
    return out * (1 - reflected * (energy + again * (1 - energy)))


def _lobe(cosine: float, roughness: float, ior: float) -> tuple[float, float]:
    """Fresnel's reflectance, mean over a GGX lobe seen at ``cosine``, and the lobe's energy after one bounce."""
    alpha = max(roughness * roughness, 1e-4)
    u, turn = ((np.indices((SIDE, SIDE)) + 0.5) / SIDE).reshape(2, -1)
    view = np.array([np.sqrt(max(1 - cosine * cosine, 0.0)), 0.0, cosine])
    stretched = view * [alpha, alpha, 1]
    stretched /= np.linalg.norm(stretched)
    side = np.array([0.0, 1.0, 0.0])
    radius, upper = np.sqrt(u), 0.5 * (1 + stretched[2])
    x, y = radius * np.cos(2 * np.pi * turn), radius * np.sin(2 * np.pi * turn)
    y = (1 - upper) * np.sqrt(np.maximum(1 - x * x, 0)) + upper * y
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    frame = np.stack([side, np.cross(stretched, side), stretched])
    normal: Array = (np.stack([x, y, z], 1) @ frame) * [alpha, alpha, 1]
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    facing = np.clip(normal @ view, 1e-4, 1)
    leaving = 2 * facing * normal[:, 2] - cosine
    seen, unseen = _smith(np.array(cosine), alpha), _smith(leaving, alpha)
    weight = np.where(leaving > 0, (1 + seen) / (1 + seen + unseen), 0.0)
    return float((weight * fresnel(facing, ior)).sum() / weight.sum()), float(weight.mean())


def _smith(cosine: Array, alpha: float) -> Array:
    tangent = np.maximum(1 - cosine * cosine, 0) / np.maximum(np.abs(cosine), 1e-4) ** 2
    return 0.5 * (np.sqrt(1 + alpha * alpha * tangent) - 1)
