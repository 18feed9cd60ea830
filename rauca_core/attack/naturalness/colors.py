"""Colors in CIELAB (CIE 15, D65, 2 degrees): distances between sRGB values, and a bound on how far paint may go.

A color beyond the bound goes back along the straight line to its reference in sRGB values, which never leaves [0, 1];
in CIELAB the shortest way may. It ends within half a percent of the bound, never beyond it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...render import srgb_to_linear
from ...runtime.kernels import njit

# IEC 61966-2-1: linear sRGB to XYZ; rows are divided by the white point, so that white is exactly (100, 0, 0).
XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
TO_WHITE = XYZ / XYZ.sum(1, keepdims=True)
KNEE = (6 / 29) ** 3  # below it the cube root gives way to a straight line
SLOPE, OFFSET = (29 / 6) ** 2 / 3, 4 / 29
FROM_ROOTS = np.array([[0.0, 116.0, 0.0], [500.0, -500.0, 0.0], [0.0, 200.0, -200.0]])


def lab(srgb: Tensor) -> Tensor:
    """CIELAB (..., 3) of sRGB values (..., 3) in [0, 1]; finite values and gradients everywhere, black included."""
    x = srgb_to_linear(srgb) @ torch.from_numpy(TO_WHITE.T).to(srgb)
    # The root's slope is infinite at 0: keep its argument off 0 even where the other branch is taken.
    root = torch.where(x > KNEE, x.clamp(min=KNEE).pow(1 / 3), SLOPE * x + OFFSET)
    return root @ torch.from_numpy(FROM_ROOTS.T).to(srgb) - torch.tensor([16.0, 0.0, 0.0]).to(srgb)


def delta_e(one: Tensor, other: Tensor) -> Tensor:
    """CIE 1976 distance (...) of two lists of CIELAB colors (..., 3); where they agree its gradient is 0."""
    return torch.linalg.vector_norm(one - other, dim=-1)


def delta_e_2000(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """CIEDE2000 (CIE 142, all weights 1) of CIELAB colors (..., 3), as in Sharma, Wu and Dalal (2005).

    Closer to what people see than the 1976 distance, but it jumps with hue: reported, not optimized.
    """
    (l1, a1, b1), (l2, a2, b2) = np.moveaxis(one, -1, 0), np.moveaxis(other, -1, 0)
    chroma = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2
    stretch = 1.5 - 0.5 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7))
    c1, c2 = np.hypot(stretch * a1, b1), np.hypot(stretch * a2, b2)
    h1, h2 = (np.degrees(np.arctan2(b, stretch * a)) % 360 for a, b in ((a1, b1), (a2, b2)))
    turn = (h2 - h1 + 180) % 360 - 180
    turn = np.where(c1 * c2 == 0, 0.0, np.where((turn == -180) & (h2 > h1), 180.0, turn))
    hue = np.where(np.abs(h1 - h2) <= 180, h1 + h2, h1 + h2 + np.where(h1 + h2 < 360, 360, -360)) / 2
    hue = np.where(c1 * c2 == 0, h1 + h2, hue)
    lightness, chroma = (l1 + l2) / 2, (c1 + c2) / 2
    t = 1 - 0.17 * _cos(hue - 30) + 0.24 * _cos(2 * hue) + 0.32 * _cos(3 * hue + 6) - 0.20 * _cos(4 * hue - 63)
    s_l = 1 + 0.015 * (lightness - 50) ** 2 / np.sqrt(20 + (lightness - 50) ** 2)
    light, c = (l2 - l1) / s_l, (c2 - c1) / (1 + 0.045 * chroma)
    h = 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn / 2)) / (1 + 0.015 * chroma * t)
    rotation = 60 * np.exp(-(((hue - 275) / 25) ** 2))
    mixed = -2 * np.sqrt(chroma**7 / (chroma**7 + 25.0**7)) * np.sin(np.radians(rotation))
    return np.asarray(np.sqrt(np.maximum(light**2 + c**2 + h**2 + mixed * c * h, 0)))


def _cos(degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.cos(np.radians(degrees)))


CLOSE, TURNS = 0.995, 36
LEVELS = 255


@njit(cache=True, nogil=True)
def _lab(red: float, green: float, blue: float) -> tuple[float, float, float]:
    linear = (_decode(red), _decode(green), _decode(blue))
    roots = np.empty(3)
    for k in range(3):
        x = TO_WHITE[k, 0] * linear[0] + TO_WHITE[k, 1] * linear[1] + TO_WHITE[k, 2] * linear[2]
        roots[k] = np.cbrt(x) if x > KNEE else SLOPE * x + OFFSET
    return (
        FROM_ROOTS[0, 1] * roots[1] - 16.0,
        FROM_ROOTS[1, 0] * (roots[0] - roots[1]),
        FROM_ROOTS[2, 1] * (roots[1] - roots[2]),
    )


@njit(cache=True, nogil=True)
def _decode(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


@njit(cache=True, nogil=True)
def _apart(one: Any, there: Any) -> float:
    light, a, b = _lab(one[0], one[1], one[2])
    return float(np.sqrt((light - there[0]) ** 2 + (a - there[1]) ** 2 + (b - there[2]) ** 2))


@njit(cache=True, nogil=True)
def distances(colors: Any, reference: Any) -> Any:
    """CIE 1976 distances (N,) of sRGB values (N, 3) in [0, 1]."""
    result = np.empty(colors.shape[0])
    for n in range(colors.shape[0]):
        there = _lab(reference[n, 0], reference[n, 1], reference[n, 2])
        result[n] = _apart(colors[n], there)
    return result


@njit(cache=True, nogil=True)
def _share(color: Any, home: Any, there: Any, bound: float, way: Any) -> float:
    """How much of the way from ``home`` to ``color`` the bound allows; ``there`` is home in CIELAB."""
    found = _apart(color, there)
    if found <= bound:
        return 1.0
    low, high = 0.0, 1.0
    share = bound / found  # distance grows about evenly along the way: this is close, and each turn closer
    for turn in range(TURNS):
        for c in range(3):
            way[c] = home[c] + share * (color[c] - home[c])
        found = _apart(way, there)
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
def draw_back(colors: Any, reference: Any, bound: float) -> None:
    """Bring colors (N, 3) to within ``bound`` of the reference (N, 3), in place; both sRGB in [0, 1], one dtype."""
    color, home, way = np.empty(3), np.empty(3), np.empty(3)
    for n in range(colors.shape[0]):
        for c in range(3):
            color[c], home[c] = colors[n, c], reference[n, c]
        there = _lab(home[0], home[1], home[2])
        share = _share(color, home, there, bound, way)
        if share < 1.0:
            for c in range(3):
                colors[n, c] = home[c] + share * (color[c] - home[c])


@njit(cache=True, nogil=True)
def round_within(colors: Any, reference: Any, bound: float) -> Any:
    """Colors (N, 3) sRGB in 8 bits, rounded towards the 8-bit reference where the nearest value would be too far."""
    result = np.empty(colors.shape, np.uint8)
    value, home = np.empty(3), np.empty(3)
    for n in range(colors.shape[0]):
        for c in range(3):
            home[c] = reference[n, c] / LEVELS
        there = _lab(home[0], home[1], home[2])
        share = 1.0
        for turn in range(LEVELS + 1):
            share = 1.0 - turn / LEVELS
            for c in range(3):
                value[c] = np.floor((home[c] + share * (colors[n, c] - home[c])) * LEVELS + 0.5) / LEVELS
            if _apart(value, there) <= bound:
                break
        for c in range(3):
            result[n, c] = np.uint8(value[c] * LEVELS + 0.5)
    return result
