"""Color transfer without training: light maps from the reference image's own statistics.

The reference image shows paint of one known albedo r, so I = A * r + B per pixel and channel. Two assumptions over the
paint of one frame split it:

* what the darkest paint sends, the first percentile, reaches every pixel without touching the paint's color: fog glow
  and the coat's dim reflections. That is B.
* nothing diffuse is brighter than the paint's 95th percentile: light beyond is a mirror image, and goes to B too.

Then A = (min(I, bright) - dark) / r and B = I - A * r: a per-pixel affine color transfer, which gives the reference
back.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .extractor import DARKEST_ALBEDO

DARK, BRIGHT = 0.01, 0.95  # quantiles of the paint's light, per channel
SOLID = 0.98  # coverage from which a pixel counts as all paint


def transfer_light(image_linear: Tensor, paint: Tensor, reference_linear: Tensor) -> tuple[Tensor, Tensor]:
    """Light maps of one frame.

    Args:
        image_linear: (3, H, W) linear frame in the reference paint.
        paint: (1, H, W) coverage of the paint.
        reference_linear: (3,) albedo of the reference paint.

    Returns:
        A and B, (3, H, W) linear; without paint A is 0 and B the image.
    """
    solid = paint[0] >= SOLID if (paint >= SOLID).any() else paint[0] > 0
    if not solid.any():
        return torch.zeros_like(image_linear), image_linear
    seen = image_linear[:, solid]
    dark, bright = (torch.quantile(seen, q, dim=1)[:, None, None] for q in (DARK, BRIGHT))
    through = (torch.minimum(image_linear, bright) - dark * paint).clamp(min=0.0) * (paint > 0)
    albedo = reference_linear.to(image_linear).clamp(min=DARKEST_ALBEDO)[:, None, None]
    A = through / albedo
    return A, image_linear - A * reference_linear.to(image_linear)[:, None, None]
