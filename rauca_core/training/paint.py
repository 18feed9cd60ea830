"""Plain paints for training: colors that cars are sold in, one or two per car. Never a pattern or noise.

The detectors stand for those that nobody hardened: what they have seen of paint is what a street shows.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract.color import srgb_to_linear

CAR_COLORS: tuple[tuple[int, int, int], ...] = (
    (238, 238, 235), (205, 207, 208), (160, 163, 166), (110, 113, 117), (64, 66, 70), (18, 18, 20),
    (150, 20, 26), (190, 40, 30), (92, 14, 24), (24, 58, 122), (40, 96, 170), (14, 26, 58), (110, 150, 190),
    (30, 72, 48), (90, 110, 60), (214, 170, 40), (206, 96, 30), (196, 180, 150), (110, 78, 54), (96, 60, 110),
)  # fmt: skip
"""8-bit sRGB: whites, greys and blacks first, for they are most of the traffic."""

NEUTRALS = 6
SHARES = (0.45, 0.35, 0.2)  # a neutral one, any of the list, any color at all
TWO_TONE = 0.15
_SPREAD = 12.0  # 8-bit values: no two whites are alike


def draw_color(rng: np.random.Generator) -> NDArray[np.float32]:
    """(3,) linear albedo of a car's paint."""
    kind = rng.choice(3, p=SHARES)
    if kind == 2:
        return srgb_to_linear(rng.random(3))
    chosen = CAR_COLORS[rng.integers(NEUTRALS if kind == 0 else len(CAR_COLORS))]
    return srgb_to_linear((np.array(chosen) + rng.normal(0, _SPREAD, 3)) / 255)


def draw_paint(rng: np.random.Generator, rows: tuple[float, float], size: int) -> Tensor:
    """A car's paint: (3, 1, 1) linear albedo, or two-tone (3, H, 1), roof and body in a color each.

    Args:
        rows: top and bottom of the car's box, pixels.
        size: H, pixels.
    """
    body = torch.from_numpy(draw_color(rng))[:, None, None]
    if rng.random() >= TWO_TONE:
        return body
    roof = torch.from_numpy(draw_color(rng))[:, None, None]
    top, bottom = rows
    edge = top + (bottom - top) * rng.uniform(0.25, 0.6)
    above = (torch.arange(size) + 0.5 < edge)[None, :, None]
    return torch.where(above, roof, body)
