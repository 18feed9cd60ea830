"""The paper's losses: attack (Eq. 6), smoothness (Eq. 7) and their sum (Eq. 8)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..detect.interface import DensePredictions
from ..render.kernels import njit

# Eq. 6 has no finite value at a detection score of 1, which a detector's sigmoid does reach in float32. Scores count as
# this little less: the loss ends at 13.8 and keeps a non-zero slope, and values below 0.99 change by under 1e-4.
SCORE_SHRINK = 1e-6
FURTHEST = 1e6  # pixels from the picture that a box's edge counts as: the square of twice that is still finite


def box_overlap(boxes: Tensor, truth: Tensor) -> Tensor:
    """Intersection over union of boxes (B, N, 4) with one box per image (B, 4), xyxy -> (B, N) in [0, 1].

    Boxes without area, or turned inside out, overlap nothing; nor do those without end, where a network's exponential
    overflowed: their gradient is 0, not NaN.
    """
    boxes, truth = boxes.clamp(-FURTHEST, FURTHEST), truth[:, None]
    corner = torch.minimum(boxes[..., 2:], truth[..., 2:]) - torch.maximum(boxes[..., :2], truth[..., :2])
    shared = corner.clamp(min=0).prod(-1)
    area = (boxes[..., 2:] - boxes[..., :2]).clamp(min=0).prod(-1)
    union = area + (truth[..., 2:] - truth[..., :2]).clamp(min=0).prod(-1) - shared
    return shared / union.clamp(min=1e-6)


def detection_score(predictions: DensePredictions, truth: Tensor, label: int) -> Tensor:
    """max H_d of Eq. 6 per image, (B,): IoU with the truth x class probability x objectness, the best over all boxes.

    Args:
        predictions: before non-maximum suppression.
        truth: (B, 4) xyxy in the image's pixels.
        label: index of the vehicle's class.
    """
    scores = box_overlap(predictions.boxes, truth) * predictions.classes[..., label] * predictions.objectness
    if scores.shape[1] == 0:
        return truth.new_zeros(len(truth))
    return scores.max(dim=1).values


def attack_loss(score: Tensor) -> Tensor:
    """Eq. 6, ``-log(1 - max H_d)``, elementwise; finite with a non-zero slope up to and at a score of 1."""
    return log_loss(score)


def log_loss(values: Tensor) -> Tensor:
    """``-log(1 - x)`` of values in [0, 1], elementwise; finite with a non-zero slope up to and at 1."""
    return -torch.log1p(-values * (1.0 - SCORE_SHRINK))


class SmoothLoss:
    """Eq. 7 over the paintable texels of a UV map: squared differences of neighbors, divided by H * W.

    A pair counts when both texels are paintable: charts are not pulled towards gutters or towards one another.
    """

    def __init__(self, texels: NDArray[np.int64], size: int) -> None:
        """``texels`` (P,): positions ``row * size + column`` in ascending order, see ``Pyramid.texels``."""
        place = np.full(size * size, -1, np.int64)
        place[texels] = np.arange(len(texels))
        grid = np.pad(place.reshape(size, size), ((0, 1), (0, 1)), constant_values=-1)
        self._right = grid[:size, 1:].ravel()[texels]
        self._below = grid[1:, :size].ravel()[texels]
        self._scale = 1.0 / size**2

    def __call__(self, texels: Tensor) -> Tensor:
        """Texels (P, 3) sRGB -> scalar."""
        if texels.device.type == "cpu":
            return _Smooth.apply(texels, self._right, self._below, self._scale)
        total = texels.new_zeros(())
        for neighbor in (self._right, self._below):
            here = torch.from_numpy(np.flatnonzero(neighbor >= 0)).to(texels.device)
            there = torch.from_numpy(neighbor[neighbor >= 0]).to(texels.device)
            total = total + (texels[here] - texels[there]).square().sum()
        return total * self._scale


class _Smooth(torch.autograd.Function):
    """One pass over the texels gives the loss and its gradient; torch would make six."""

    @staticmethod
    def forward(ctx: Any, texels: Tensor, right: Any, below: Any, scale: float) -> Tensor:
        gradient = torch.zeros_like(texels)
        total = _squared_steps(texels.detach().contiguous().numpy(), right, below, gradient.numpy())
        ctx.save_for_backward(gradient.mul_(2 * scale))
        return texels.new_tensor(total * scale)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        return ctx.saved_tensors[0] * gradients[0], None, None, None


@njit(cache=True)
def _squared_steps(texels: Any, right: Any, below: Any, gradient: Any) -> float:
    total = 0.0
    for i in range(texels.shape[0]):
        for neighbor in (right[i], below[i]):
            if neighbor < 0:
                continue
            for c in range(3):
                step = texels[i, c] - texels[neighbor, c]
                total += step * step
                gradient[i, c] += step
                gradient[neighbor, c] -= step
    return total
