"""Random output augmentation in one pass over the picture, and its gradient in one pass back.

torch's grid_sample, mean, contrast and clamp read and write every picture eight times. Rows of pixels are stored with
their channels together here, as the renderer leaves them and as convolutions on a CPU like them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..runtime.kernels import njit

CHANNELS = 3


def augment(images: Tensor, to_source: Tensor, brightness: Tensor, contrast: Tensor, backdrop: float) -> Tensor:
    """Move and relight pictures on the CPU; what ``relight(move_images(images))`` gives.

    Args:
        images: (B, 3, H, W) float32 or float64 sRGB.
        to_source: (B, 2, 3) from a pixel's center (x, y, 1) in the result to its place in the source, both in pixels.
        brightness, contrast: (B,).
        backdrop: sRGB value outside the source.

    Returns:
        (B, 3, H, W), channels last in memory.
    """
    moved: Tensor = _Augment.apply(images, to_source, brightness, contrast, backdrop)
    return moved


class _Augment(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, images: Tensor, to_source: Tensor, brightness: Tensor, contrast: Tensor, backdrop: float
    ) -> Tensor:
        source = _pixels(images.detach())
        result = np.empty_like(source)
        matrices, offsets, factors = (t.to(images).numpy() for t in (to_source, brightness, contrast))
        _forward(source, matrices, offsets, factors, source.dtype.type(backdrop), result)
        ctx.matrices, ctx.factors, ctx.result = matrices, factors, result
        ctx.relit = (factors != 1) | (offsets != 0)
        return torch.from_numpy(result).permute(0, 3, 1, 2)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None, None]:
        handed = _pixels(gradients[0]).copy()
        gradient = np.zeros_like(handed)
        _backward(handed, ctx.matrices, ctx.factors, ctx.relit, ctx.result, gradient)
        return torch.from_numpy(gradient).permute(0, 3, 1, 2), None, None, None, None


def _pixels(images: Tensor) -> Any:
    """(B, 3, H, W) -> array (B, H, W, 3), contiguous; no copy where channels are last in memory."""
    return images.permute(0, 2, 3, 1).contiguous().numpy()


@njit(cache=True, nogil=True)
def _forward(source: Any, to_source: Any, brightness: Any, contrast: Any, backdrop: Any, result: Any) -> None:
    height, width = source.shape[1], source.shape[2]
    for b in range(source.shape[0]):
        matrix, total = to_source[b], 0.0
        for row in range(height):
            for column in range(width):
                top, left, upper, lower, first, second = _tap(matrix, row, column)
                if 0 <= top < height - 1 and 0 <= left < width - 1:
                    one, two, three, four = upper * first, upper * second, lower * first, lower * second
                    for c in range(CHANNELS):
                        result[b, row, column, c] = (
                            one * source[b, top, left, c] + two * source[b, top, left + 1, c]
                            + three * source[b, top + 1, left, c] + four * source[b, top + 1, left + 1, c]
                        )  # fmt: skip
                else:
                    for c in range(CHANNELS):
                        result[b, row, column, c] = backdrop
                    for i, down in ((top, upper), (top + 1, lower)):
                        for j, across in ((left, first), (left + 1, second)):
                            if 0 <= i < height and 0 <= j < width:
                                for c in range(CHANNELS):
                                    result[b, row, column, c] += down * across * (source[b, i, j, c] - backdrop)
                for c in range(CHANNELS):
                    total += result[b, row, column, c]
        mean = total / (height * width * CHANNELS)
        _relight(result[b].reshape(-1), contrast[b], source.dtype.type(mean - mean * contrast[b] + brightness[b]))


@njit(cache=True, nogil=True)
def _backward(handed: Any, to_source: Any, contrast: Any, relit: Any, result: Any, gradient: Any) -> None:
    height, width = handed.shape[1], handed.shape[2]
    for b in range(handed.shape[0]):
        matrix, total = to_source[b], 0.0
        if relit[b]:  # what was only moved is not clipped: 0 and 1 are its own, and keep their gradient
            total = _unclip(handed[b].reshape(-1), result[b].reshape(-1))
        # Every pixel also moves the mean that contrast turns about.
        factor, common = contrast[b], handed.dtype.type(total * (1 - contrast[b]) / (height * width * CHANNELS))
        for row in range(height):
            for column in range(width):
                top, left, upper, lower, first, second = _tap(matrix, row, column)
                if 0 <= top < height - 1 and 0 <= left < width - 1:
                    one, two, three, four = upper * first, upper * second, lower * first, lower * second
                    for c in range(CHANNELS):
                        given = handed[b, row, column, c] * factor + common
                        gradient[b, top, left, c] += one * given
                        gradient[b, top, left + 1, c] += two * given
                        gradient[b, top + 1, left, c] += three * given
                        gradient[b, top + 1, left + 1, c] += four * given
                else:
                    for i, down in ((top, upper), (top + 1, lower)):
                        for j, across in ((left, first), (left + 1, second)):
                            if 0 <= i < height and 0 <= j < width:
                                for c in range(CHANNELS):
                                    given = handed[b, row, column, c] * factor + common
                                    gradient[b, i, j, c] += down * across * given


@njit(cache=True, nogil=True)
def _tap(matrix: Any, row: int, column: int) -> Any:
    """The upper left of the four pixels that a pixel reads, and the shares of rows and columns."""
    x, y = column + 0.5, row + 0.5
    across = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] - 0.5
    down = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] - 0.5
    left, top = int(np.floor(across)), int(np.floor(down))
    kind = matrix.dtype.type
    second, lower = kind(across - left), kind(down - top)
    return top, left, kind(1.0) - lower, lower, kind(1.0) - second, second


@njit(cache=True, nogil=True)
def _relight(values: Any, factor: Any, shift: Any) -> None:
    low, high = values.dtype.type(0.0), values.dtype.type(1.0)
    for i in range(values.shape[0]):
        value = values[i] * factor + shift
        value = low if value < low else value  # NaN stays NaN
        values[i] = high if value > high else value


@njit(cache=True, nogil=True)
def _unclip(handed: Any, result: Any) -> float:
    """Clear the gradient where the result was clipped; returns what is left, summed."""
    total = 0.0
    for i in range(handed.shape[0]):
        if not 0.0 < result[i] < 1.0:
            handed[i] = 0.0
        total += handed[i]
    return total
