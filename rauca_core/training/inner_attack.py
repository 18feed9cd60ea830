"""An attack step inside a training step: the paint of a composed picture moves to where the detector's loss grows most.

Light is affine in the paint, so what a pixel shows in black and in white paint bounds what any paint can make of it. A
cell of the picture moves a share of the way to one of the two, in each channel by the sign of its first-order gain.
Only the half of the cells that gain most do, as patches lie where the gradient is largest (the idea of PBCAT: Li et
al., patch-based composite adversarial training, ICCV 2025; a single signed step is Goodfellow et al., ICLR 2015).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ..render.straight_through import straight_through

CELLS = (4, 8, 16, 32, 64)  # pixels, one drawn for each step: from a pattern to a third of the vehicle
MOVED = 0.5  # share of the cells with paint in them


def attacked(
    images: Tensor,
    black: Tensor,
    white: Tensor,
    loss: Callable[[Tensor], Tensor],
    reach: float,
    rng: np.random.Generator,
) -> Tensor:
    """Images (B, 3, H, W) sRGB in [0, 1], after one step that makes a loss larger.

    Args:
        black, white: the same pictures in black and in white paint; where they are alike there is no paint, and nothing
            moves.
        loss: of images; its graph is freed.
        reach: how much of the way to black or white, in [0, 1].
        rng: draws the cells' size and where they begin.

    Returns:
        Pictures whose gradient goes to ``images``, as if none had moved.
    """
    moving = images.detach().requires_grad_()
    (gradient,) = torch.autograd.grad(loss(moving), moving)
    cell = int(rng.choice(CELLS))
    shift = int(rng.integers(cell)), int(rng.integers(cell))
    ways = [limit - images.detach() for limit in (black, white)]
    down, up = (_of_cells(gradient * way, cell, shift) for way in ways)
    gain = torch.maximum(down, up).clamp(min=0)
    of_cell = gain.sum(1, keepdim=True)
    enough = torch.stack([_enough(one) for one in of_cell])[:, None, None, None]
    moves = (gain > 0) & (of_cell >= enough)
    shares = [
        _of_pixels((moves & better).to(images), cell, shift, images.shape[2:]) for better in (down > up, up >= down)
    ]
    return straight_through(images, (images + reach * (shares[0] * ways[0] + shares[1] * ways[1])).detach())


def _enough(gains: Tensor) -> Tensor:
    """The gain from which on a picture's cells move."""
    there = gains[gains > 0]
    return there.quantile(1 - MOVED) if len(there) else gains.new_zeros(())


def _of_cells(values: Tensor, cell: int, shift: tuple[int, int]) -> Tensor:
    """(B, 3, H, W) summed over cells; the first ones reach beyond the picture by ``shift`` pixels."""
    height, width = values.shape[2:]
    top, left = shift
    padded = functional.pad(values, (left, -(left + width) % cell, top, -(top + height) % cell))
    return functional.avg_pool2d(padded, cell) * cell**2


def _of_pixels(values: Tensor, cell: int, shift: tuple[int, int], size: torch.Size) -> Tensor:
    """(B, 3, rows, columns) of cells as (B, 3, H, W)."""
    whole = values.repeat_interleave(cell, 2).repeat_interleave(cell, 3)
    return whole[:, :, shift[0] : shift[0] + size[0], shift[1] : shift[1] + size[1]]
