"""From texture to display: affine light transport, then the sRGB transfer function."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..runtime.kernels import njit

_KNEE_LINEAR = 0.0031308
_KNEE_SRGB = 0.04045
TABLE = 4096  # intervals; between their ends the curve is straight to 2e-8


def composite(x_bar_linear: Tensor, A: Tensor, B: Tensor) -> Tensor:
    """Light the paint: ``A * x + B``, per pixel and channel, linear.

    A already holds the paint's coverage, so x must be the *coverage-normalized* texture; the plain average would darken
    edges twice.

    Args:
        x_bar_linear: albedo, any shape, e.g. (B, 3, H, W) or (R, 3).
        A, B: light maps, broadcastable.
    """
    return A * x_bar_linear + B


def saturate(values: Tensor) -> Tensor:
    """Clip to [0, 1], as a camera does: any shape, gradient 0 beyond and 1 at both ends, NaN stays NaN.

    At its ends torch.clamp has the gradient 1 until torch 2.13 and 0 from 2.14 on, which would freeze black and white
    texels for good.
    """
    return torch.where((values >= 0.0) & (values <= 1.0), values, values.detach().clamp(0.0, 1.0))


def linear_to_srgb(linear: Tensor) -> Tensor:
    """Encode linear light as sRGB in [0, 1] (IEC 61966-2-1).

    Light beyond [0, 1] is clipped and has zero gradient, as a camera that saturates; within, the gradient is exact and
    at most 12.92, the slope at 0. NaN stays NaN.
    """
    x = saturate(linear)
    # The power's slope is infinite at 0: keep its argument off 0 even where the other branch is taken.
    curve = 1.055 * x.clamp(min=_KNEE_LINEAR).pow(1 / 2.4) - 0.055
    return torch.where(x <= _KNEE_LINEAR, 12.92 * x, curve)


def srgb_to_linear(srgb: Tensor) -> Tensor:
    """Decode sRGB values in [0, 1] to linear light; values beyond are clipped and have zero gradient."""
    decoded: Tensor = _Decode.apply(srgb)
    return decoded


class _Decode(torch.autograd.Function):
    """The whole UV map passes here at every step: the value and its slope come from one pass.

    float32 on the CPU reads both from a table, off by less than its last digit; a power takes three times as long.
    """

    @staticmethod
    def forward(ctx: Any, srgb: Tensor) -> Tensor:
        if srgb.device.type == "cpu" and srgb.dtype == torch.float32:
            source = srgb.detach().contiguous()
            value, slope = torch.empty_like(source), torch.empty_like(source)
            _look_up(source.numpy().ravel(), *_decoding_table(), value.numpy().ravel(), slope.numpy().ravel())
        else:
            value, slope = _decode(srgb)
        ctx.save_for_backward(slope)
        return value

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        slope: Tensor = ctx.saved_tensors[0]
        return slope * gradients[0]


def _decode(srgb: Tensor) -> tuple[Tensor, Tensor]:
    """Linear light and its slope."""
    base = (srgb.clamp(0.0, 1.0) + 0.055) / 1.055
    power = base.pow(1.4)
    low = srgb <= _KNEE_SRGB
    inside = (srgb >= 0.0) & (srgb <= 1.0)
    slope = torch.where(low, 1 / 12.92, power * (2.4 / 1.055)) * inside
    return torch.where(low, srgb.clamp(min=0.0) / 12.92, power * base), slope


@cache
def _decoding_table() -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Value and slope at both ends of each interval (TABLE, 2) of sRGB values in [0, 1]."""
    value, slope = (t.numpy() for t in _decode(torch.linspace(0.0, 1.0, TABLE + 1, dtype=torch.float64)))
    ends = [np.stack([t[:-1], t[1:]], 1).astype(np.float32) for t in (value, slope)]
    return ends[0], ends[1]


@njit(cache=True, nogil=True)
def _look_up(srgb: Any, values: Any, slopes: Any, value: Any, slope: Any) -> None:
    for i in range(srgb.shape[0]):
        x = srgb[i]
        if 0.0 <= x <= 1.0:
            place = x * np.float32(TABLE)
            k = min(int(place), TABLE - 1)
            far = place - np.float32(k)
            value[i] = values[k, 0] + far * (values[k, 1] - values[k, 0])
            slope[i] = slopes[k, 0] + far * (slopes[k, 1] - slopes[k, 0])
        else:
            value[i] = np.float32(0.0) if x < 0.0 else min(x, np.float32(1.0))  # NaN stays NaN
            slope[i] = np.float32(0.0)
