"""A detector's gradient against its own differences."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor


def checked_gradient(
    detector: Any, images: Tensor, boxes: float = 0.01, step: float = 1e-6, rtol: float = 1e-5, atol: float = 1e-7
) -> Tensor:
    """The gradient with respect to ``images`` (B, 3, H, W), found to match differences along a random direction.

    The network is made float64, where differences are exact enough; what is differentiated is the sum of squared scores
    and ``boxes`` times that of the boxes' sines.
    """
    detector.network.double()
    images = images.detach().double().requires_grad_()
    direction = torch.randn(images.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(1))

    def total(x: Tensor) -> Tensor:
        found = detector.dense(x)
        return (found.objectness[..., None] * found.classes).square().sum() + boxes * found.boxes.sin().sum()

    (gradient,) = torch.autograd.grad(total(images), images)
    with torch.no_grad():
        numeric = (total(images + step * direction) - total(images - step * direction)) / (2 * step)
    torch.testing.assert_close((gradient * direction).sum(), numeric, rtol=rtol, atol=atol)
    return gradient
