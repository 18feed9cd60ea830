"""Two colors in one picture of a vehicle: light that came back through the paint has the paint's, mirrored light none.

What a picture shows of paint with the albedo r is a * r + s, per pixel: a diffuse part in the paint's color, and mirror
images, which are nearly grey against a saturated paint (the dichromatic reflection model, Shafer 1985). Where r is
saturated the color of a pixel says what a is; where r is grey it says nothing, and the network's word stands. So the
three channels of A are alike in shape, and what is left is mirrored: B.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import color

DOUBT = 0.02  # share of a reference's squared length that is chroma, at which its color is half believed
SLACK = 0.3  # by which the channels of A may differ where the reference is brightest: paint and light are not one color
TINT = 0.5  # of the surroundings' color is the light's, the rest their own
SOLID = 0.98  # coverage from which a pixel counts as all paint
LEAST = 1e-3  # albedo or light, below which a channel tells nothing

PUREST = 0.2  # of the paint's pixels, by which its color is told: the others mirror more
GROUND = 0.2  # albedo of what surrounds a vehicle
LIGHTEST, DARKEST = 0.9, 0.02  # albedo of a paint's brightest channel


def split_colors(A: Tensor, B: Tensor, mask: Tensor, reference_linear: Tensor) -> tuple[Tensor, Tensor]:
    """Light maps as the network made them, mended by what the paint's color tells.

    Args:
        A, B: (3, H, W) linear, of the paint and its surroundings.
        mask: (1, H, W) coverage of the paint.
        reference_linear: (3,) albedo of the paint in the image.

    Returns:
        A and B of the same image: those given for a grey reference, the more others the more saturated it is.
    """
    r, painted = reference_linear.to(A), mask[0] > 0
    colored = r - r.mean()
    chroma = colored.square().sum() / r.square().sum().clamp(min=1e-12)
    belief = chroma**2 / (chroma**2 + DOUBT**2)
    if chroma < 1e-6 or not painted.any():
        return A, B
    tint = _tint(B[:, ~painted])[:, None]
    through, cover, r = A[:, painted] / tint, mask[0, painted], r[:, None]
    seen = through * r + B[:, painted] / tint
    guessed = (through * r.square()).sum(0) / r.square().sum()
    amount = belief * (colored @ seen) / colored.square().sum() + (1 - belief) * guessed
    solid = amount[cover >= SOLID]
    most = (solid if len(solid) else amount).max().clamp(min=0.0)
    amount = torch.minimum(amount.clamp(min=0.0), cover * most)  # beyond an edge lies another color
    slack = SLACK * r / r.max()
    low, high = amount * (1 - slack), amount * (1 + slack)
    mirrored = (seen - low * r).amin(0).clamp(min=0.0)
    alike = torch.minimum(torch.maximum((seen - mirrored) / r.clamp(min=LEAST), low), high)
    mended = belief * alike + (1 - belief) * through
    A, B = A.clone(), B.clone()
    A[:, painted] = mended * tint
    B[:, painted] = (seen - mended * r).clamp(min=0.0) * tint
    return A, B


def _tint(around: Tensor) -> Tensor:
    """(3,) color of the light, of mean 1, by what lies around the paint, (3, N) linear."""
    if around.numel() == 0:
        return torch.ones(3, dtype=around.dtype)
    mean = around.mean(1) + LEAST
    return 1 + TINT * (mean / mean.mean() - 1)


def find_paint_color(image_srgb: NDArray[np.uint8], paint: NDArray[np.floating]) -> color.Color:
    """A picture's paint color where nobody says it: hue by the pixels that mirror least, lightness by the ground.

    Args:
        image_srgb: (H, W, 3) 8-bit.
        paint: (H, W) coverage of the paint in [0, 1].

    Returns:
        8-bit sRGB. Its lightness is a guess: a picture tells a dark paint in much light from a light one in little only
        by what lies around.
    """
    linear = color.srgb_to_linear(image_srgb / 255.0)
    solid = paint >= min(SOLID, float(paint.max()))
    seen, around = linear[solid], linear[paint <= 0]
    lit = seen[seen.mean(1) >= np.median(seen.mean(1)) / 2]
    purity = 1 - lit.min(1) / (lit.max(1) + LEAST)
    hue = np.median(lit[purity >= np.quantile(purity, 1 - PUREST)], axis=0)
    light = np.median(around.mean(1)) / GROUND if len(around) else 1.0
    albedo = hue * np.median(seen.mean(1)) / max(hue.mean(), LEAST) / max(light, LEAST)
    albedo *= np.clip(albedo.max(), DARKEST, LIGHTEST) / max(albedo.max(), LEAST)
    red, green, blue = (int(v) for v in color.to_bytes(color.linear_to_srgb(albedo)))
    return red, green, blue
