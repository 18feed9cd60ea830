"""JPEG as a differentiable function, for an attacker who knows of it: the codec's steps on floats, rounding smoothed.

Colors go to YCbCr, chroma to half resolution, blocks of 8x8 to cosines; these are divided by the quantization tables of
ITU-T T.81, annex K, scaled by quality as libjpeg does, and rounded with a smooth slope (an idea of Shin and Song,
JPEG-resistant Adversarial Images, NIPS 2017 workshop).
"""

from __future__ import annotations

import math
from functools import cache

import torch
from torch import Tensor
from torch.nn import functional

_LUMA = (
    (16, 11, 10, 16, 24, 40, 51, 61), (12, 12, 14, 19, 26, 58, 60, 55), (14, 13, 16, 24, 40, 57, 69, 56),
    (14, 17, 22, 29, 51, 87, 80, 62), (18, 22, 37, 56, 68, 109, 103, 77), (24, 35, 55, 64, 81, 104, 113, 92),
    (49, 64, 78, 87, 103, 121, 120, 101), (72, 92, 95, 98, 112, 100, 103, 99),
)  # fmt: skip
_CHROMA = (
    (17, 18, 24, 47, 99, 99, 99, 99), (18, 21, 26, 66, 99, 99, 99, 99), (24, 26, 56, 99, 99, 99, 99, 99),
    (47, 66, 99, 99, 99, 99, 99, 99), *(((99,) * 8,) * 4),
)  # fmt: skip
_TO_YCC = ((0.299, 0.587, 0.114), (-0.168736, -0.331264, 0.5), (0.5, -0.418688, -0.081312))
_TO_RGB = ((1.0, 0.0, 1.402), (1.0, -0.344136, -0.714136), (1.0, 1.772, 0.0))


def smooth_jpeg(images: Tensor, quality: int) -> Tensor:
    """(B, 3, H, W) sRGB in [0, 1] -> about what saving and loading them at a quality of 1 to 100 leaves."""
    height, width = images.shape[2:]
    # Whole blocks of chroma are 16 pixels wide; the codec repeats the border, too.
    padded = functional.pad(images, (0, -width % 16, 0, -height % 16), mode="replicate")
    ycc = torch.einsum("kc,bchw->bkhw", _matrix(_TO_YCC, images), padded) * 255
    luma = _coded(ycc[:, :1] - 128, _table(_LUMA, quality, images)) + 128
    chroma = _coded(functional.avg_pool2d(ycc[:, 1:], 2), _table(_CHROMA, quality, images))
    chroma = functional.interpolate(chroma, scale_factor=2, mode="bilinear", align_corners=False)
    rgb = torch.einsum("ck,bkhw->bchw", _matrix(_TO_RGB, images), torch.cat([luma, chroma], 1)) / 255
    return rgb[:, :, :height, :width].clamp(0, 1)


def smooth_round(values: Tensor) -> Tensor:
    """Rounded, with the slope that rounding has on average if values are off by a third of a step: .8 at whole numbers,
    1.2 between them.

    Shin and Song's cubic has slope 0 at whole numbers, and stops an attack that has to cross a step.
    """
    smooth = values - torch.sin(2 * math.pi * values) / (10 * math.pi)
    return values.detach().round() + smooth - smooth.detach()


def _coded(planes: Tensor, table: Tensor) -> Tensor:
    """(B, C, H, W) in levels of 8 bits, sides of whole blocks, after quantization by a table (8, 8)."""
    batch, channels, height, width = planes.shape
    blocks = planes.reshape(batch, channels, height // 8, 8, width // 8, 8)
    cosines = _cosines().to(planes)
    spectrum = torch.einsum("ui,bcyixj,vj->bcyuxv", cosines, blocks, cosines)
    kept = smooth_round(spectrum / table[:, None]) * table[:, None]
    return torch.einsum("ui,bcyuxv,vj->bcyixj", cosines, kept, cosines).reshape(planes.shape)


@cache
def _cosines() -> Tensor:
    """(8, 8) orthonormal DCT-II: frequency by place."""
    places = (torch.arange(8, dtype=torch.float64) + 0.5) * math.pi / 8
    waves = torch.cos(torch.arange(8, dtype=torch.float64)[:, None] * places) / 2
    waves[0] /= math.sqrt(2)
    return waves


def _table(numbers: tuple[tuple[int, ...], ...], quality: int, like: Tensor) -> Tensor:
    """(8, 8) steps of quantization at a quality, as libjpeg scales them."""
    scale = 5000 // quality if quality < 50 else 200 - 2 * quality
    return ((torch.tensor(numbers) * scale + 50) // 100).clamp(1, 255).to(like)


def _matrix(rows: tuple[tuple[float, ...], ...], like: Tensor) -> Tensor:
    return torch.tensor(rows).to(like)
