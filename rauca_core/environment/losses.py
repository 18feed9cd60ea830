"""Losses of the environment feature extractor, finite on every frame: black, white, without a vehicle."""

from __future__ import annotations

import torch
from torch import Tensor

EPSILON = 1e-4  # half of an 8-bit level would be 2e-3: far below what a frame can hold


def vehicle_weight(mask: Tensor) -> Tensor:
    """W of Eq. 5, h * w / s, where s is the vehicle's area in pixels; 0 for a frame without a vehicle.

    Args:
        mask: (B, 1, H, W) coverage in [0, 1].

    Returns:
        (B,) weights.
    """
    area = mask.flatten(1).sum(dim=1)
    pixels = mask[0].numel()
    # Below half a pixel there is no vehicle to learn from, and 1 / s would only enlarge rounding.
    return torch.where(area >= 0.5, pixels / area.clamp(min=0.5), 0.0)


def weighted_bce(x_ren_srgb: Tensor, x_gt_srgb: Tensor, mask: Tensor) -> Tensor:
    """Eq. 5: binary cross-entropy over the whole masked image, times W.

    As with torch's own, a pixel's loss is smallest, but not 0, where prediction equals truth. The prediction is
    squeezed into [eps, 1 - eps], not clamped: a wrong 0 or 1 keeps a finite gradient that leads away from it.

    Args:
        x_ren_srgb, x_gt_srgb: (B, 3, H, W) in [0, 1], 0 outside the vehicle.
        mask: (B, 1, H, W) coverage of the vehicle.

    Returns:
        The mean over the batch.
    """
    p = EPSILON + (1 - 2 * EPSILON) * x_ren_srgb
    entropy = -(x_gt_srgb * p.log() + (1 - x_gt_srgb) * (1 - p).log())
    return ((entropy * (mask > 0)).flatten(1).mean(dim=1) * vehicle_weight(mask)).mean()


def tone(linear: Tensor) -> Tensor:
    """The sRGB curve carried on beyond 1 with its slope there, so that light too bright to show still has a gradient.

    Finite with a finite gradient for every finite input; negative light is taken as 0.
    """
    x = torch.where(linear >= 0.0, linear, linear.detach().clamp(min=0.0))  # its gradient at 0 is the curve's
    knee = 0.0031308
    curve = 1.055 * x.clamp(knee, 1.0).pow(1 / 2.4) - 0.055
    line = 1.0 + (1.055 / 2.4) * (x - 1.0)
    return torch.where(x <= knee, 12.92 * x, torch.where(x < 1.0, curve, line))


def light_loss(
    predicted: tuple[Tensor, Tensor],
    exact: tuple[Tensor, Tensor],
    albedo: Tensor,
    mask: Tensor,
    weighted: bool = True,
) -> Tensor:
    """How far predicted light maps are from the exact ones, as seen on paints of given colors.

    One inference serves every color: the maps are compared through what a detector would see, ``tone(A * x + B)``, for
    each albedo x. Errors beyond a tenth of the display's range count linearly, as a mirrored sun is not worth a car.

    Args:
        predicted, exact: A and B, (B, 3, H, W) linear.
        albedo: (C, B, 3, 1, 1) or (C, B, 3, H, W) linear albedo in [0, 1] of C paints.
        mask: (B, 1, H, W) coverage of the paint; with W each frame counts by its mean over the paint.
        weighted: leave W of Eq. 5 out for the ablation: frames then count by the paint's area.
    """
    painted = mask[:, 0] > 0  # a tenth of the pixels: the others weigh nothing
    A, B, A_exact, B_exact = (m.transpose(0, 1)[:, painted] for m in (*predicted, *exact))
    x = albedo.expand(-1, -1, -1, *mask.shape[-2:]).transpose(1, 2)[:, :, painted]
    seen, truth = tone(x * A + B), tone(x * A_exact + B_exact)
    error = torch.nn.functional.huber_loss(seen, truth.clamp(max=1.5), reduction="none", delta=0.1)
    weight = vehicle_weight(mask)[:, None, None, None] * mask if weighted else mask
    return (error * weight[:, 0][painted]).sum() / (len(albedo) * 3 * mask.numel())
