"""Nowhere farther from the reference than a distance in CIELAB: colors beyond it are drawn back.

A color goes back along the straight line to its reference in sRGB values, which never leaves [0, 1]; in CIELAB the
shortest way may. It ends within half a percent of the bound, never beyond it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...render.kernels import njit
from .lab import FROM_ROOTS, KNEE, OFFSET, SLOPE, TO_WHITE

CLOSE, TURNS = 0.995, 36
LEVELS = 255


def draw_back(colors: NDArray[Any], reference: NDArray[Any], bound: float) -> None:
    """Bring colors (N, 3) to within ``bound`` of the reference (N, 3), in place; both sRGB in [0, 1], one dtype."""
    _draw_back(colors, reference, bound, TO_WHITE, FROM_ROOTS)


def round_within(colors: NDArray[Any], reference: NDArray[np.uint8], bound: float) -> NDArray[np.uint8]:
    """Colors (N, 3) sRGB in 8 bits, rounded towards the 8-bit reference where the nearest value would be too far."""
    result = np.empty(colors.shape, np.uint8)
    _round_within(colors.astype(np.float64), reference, bound, TO_WHITE, FROM_ROOTS, result)
    return result


def distances(colors: NDArray[Any], reference: NDArray[Any]) -> NDArray[np.float64]:
    """CIE 1976 distances (N,) of sRGB values (N, 3) in [0, 1]."""
    result = np.empty(len(colors))
    _distances(colors.astype(np.float64), reference.astype(np.float64), TO_WHITE, FROM_ROOTS, result)
    return result


@njit(cache=True, nogil=True)
def _lab(red: float, green: float, blue: float, to_white: Any, from_roots: Any) -> tuple[float, float, float]:
    linear = (_decode(red), _decode(green), _decode(blue))
    roots = np.empty(3)
    for k in range(3):
        x = to_white[k, 0] * linear[0] + to_white[k, 1] * linear[1] + to_white[k, 2] * linear[2]
        roots[k] = np.cbrt(x) if x > KNEE else SLOPE * x + OFFSET
    return (
        from_roots[0, 1] * roots[1] - 16.0,
        from_roots[1, 0] * (roots[0] - roots[1]),
        from_roots[2, 1] * (roots[1] - roots[2]),
    )


@njit(cache=True, nogil=True)
def _decode(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


@njit(cache=True, nogil=True)
def _apart(one: Any, there: Any, to_white: Any, from_roots: Any) -> float:
    light, a, b = _lab(one[0], one[1], one[2], to_white, from_roots)
    return float(np.sqrt((light - there[0]) ** 2 + (a - there[1]) ** 2 + (b - there[2]) ** 2))


@njit(cache=True, nogil=True)
def _distances(colors: Any, reference: Any, to_white: Any, from_roots: Any, result: Any) -> None:
    for n in range(colors.shape[0]):
        there = _lab(reference[n, 0], reference[n, 1], reference[n, 2], to_white, from_roots)
        result[n] = _apart(colors[n], there, to_white, from_roots)


@njit(cache=True, nogil=True)
def _share(color: Any, home: Any, there: Any, bound: float, to_white: Any, from_roots: Any, way: Any) -> float:
    """How much of the way from ``home`` to ``color`` the bound allows; ``there`` is home in CIELAB."""
    found = _apart(color, there, to_white, from_roots)
    if found <= bound:
        return 1.0
    low, high = 0.0, 1.0
    share = bound / found  # distance grows about evenly along the way: this is close, and each turn closer
    for turn in range(TURNS):
        for c in range(3):
            way[c] = home[c] + share * (color[c] - home[c])
        found = _apart(way, there, to_white, from_roots)
        if found <= bound:
            low = share
            if found >= CLOSE * bound:
                break
        else:
            high = share
        guess = share * bound * (0.5 + 0.5 * CLOSE) / max(found, 1e-12)
        share = guess if low < guess < high and turn % 3 < 2 else 0.5 * (low + high)
    return low


@njit(cache=True, nogil=True)
def _draw_back(colors: Any, reference: Any, bound: float, to_white: Any, from_roots: Any) -> None:
    color, home, way = np.empty(3), np.empty(3), np.empty(3)
    for n in range(colors.shape[0]):
        for c in range(3):
            color[c], home[c] = colors[n, c], reference[n, c]
        there = _lab(home[0], home[1], home[2], to_white, from_roots)
        share = _share(color, home, there, bound, to_white, from_roots, way)
        if share < 1.0:
            for c in range(3):
                colors[n, c] = home[c] + share * (color[c] - home[c])


@njit(cache=True, nogil=True)
def _round_within(colors: Any, reference: Any, bound: float, to_white: Any, from_roots: Any, result: Any) -> None:
    value, home = np.empty(3), np.empty(3)
    for n in range(colors.shape[0]):
        for c in range(3):
            home[c] = reference[n, c] / LEVELS
        there = _lab(home[0], home[1], home[2], to_white, from_roots)
        share = 1.0
        for turn in range(LEVELS + 1):
            share = 1.0 - turn / LEVELS
            for c in range(3):
                value[c] = np.floor((home[c] + share * (colors[n, c] - home[c])) * LEVELS + 0.5) / LEVELS
            if _apart(value, there, to_white, from_roots) <= bound:
                break
        for c in range(3):
            result[n, c] = np.uint8(value[c] * LEVELS + 0.5)
