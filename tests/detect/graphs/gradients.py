"""A detector's gradient against its own differences."""

from __future__ import annotations

from typing import Any

import torch


def checked_gradient(detector: Any, height: int, width: int) -> torch.Tensor:
    """The gradient (2, 3, H, W) float64 with respect to noise, found to match differences along one direction."""
    detector.network.double()
    torch.manual_seed(0)
    images = torch.rand(2, 3, height, width, dtype=torch.float64, requires_grad=True)

    def total(x: torch.Tensor) -> torch.Tensor:
        found = detector.dense(x)
        return found.classes.square().sum() + 0.01 * found.boxes.sin().sum()

    (gradient,) = torch.autograd.grad(total(images), images)
    direction = torch.randn_like(images)
    step = 1e-6
    with torch.no_grad():
        numeric = (total(images + step * direction) - total(images - step * direction)) / (2 * step)
    torch.testing.assert_close((gradient * direction).sum(), numeric, rtol=1e-5, atol=1e-7)
    return gradient
