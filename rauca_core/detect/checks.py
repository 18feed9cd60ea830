"""What every detector asks of the images it is given, so that a wrong batch is one clear error and not a low score.

Cost: shape and type are free. Looking at the values is one pass over the pixels without a graph, below a hundredth of
the smallest network's time. On an accelerator it would make the host wait for the device, so :func:`check_images` looks
at values there only when asked to: ``detect`` asks, as it waits for its results anyway, ``dense`` does not.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from ..contract import RaucaError

# Rounding of resampling and of half precision; a batch in 0..255 or a normalized one lies far outside.
RANGE_TOLERANCE = 1e-2


def check_images(name: str, images: Tensor, waits: bool = False) -> None:
    """Refuse what is not a batch of sRGB images (B, 3, H, W) in [0, 1]. Gradients are not touched.

    Args:
        name: the detector's, for the message.
        waits: the caller waits for the device anyway, so look at the values wherever they are.

    Raises:
        RaucaError: not a tensor of that shape, no pixels, not floating point, values out of range, NaN or infinite.
    """
    if not isinstance(images, Tensor):
        raise RaucaError(f"{name}: images must be a torch tensor, not {type(images).__name__}")
    if images.ndim != 4 or images.shape[1] != 3 or 0 in images.shape:
        raise RaucaError(f"{name}: images must have shape (B, 3, H, W), not {tuple(images.shape)}")
    if not images.dtype.is_floating_point:
        raise RaucaError(f"{name}: images must be sRGB in [0, 1] as floating point, not {images.dtype}; divide by 255")
    if waits or images.device.type == "cpu":
        _check_values(name, images.detach())


def in_type_of(network: nn.Module | None, images: Tensor) -> Tensor:
    """Images in the floating-point type that a network computes in, float32 where it says none; gradients flow."""
    parameters = () if network is None else network.parameters()
    return images.to(next((p.dtype for p in parameters if p.is_floating_point()), torch.float32))


def _check_values(name: str, images: Tensor) -> None:
    low, high = (float(value) for value in torch.stack(torch.aminmax(images)).tolist())
    if math.isnan(low) or math.isinf(low) or math.isinf(high):
        bad = (~torch.isfinite(images)).flatten(1).sum(1).tolist()
        first = next(index for index, count in enumerate(bad) if count)
        raise RaucaError(f"{name}: image {first} of the batch holds {bad[first]} NaN or infinite values")
    if low < -RANGE_TOLERANCE or high > 1 + RANGE_TOLERANCE:
        raise RaucaError(
            f"{name}: images must be sRGB in [0, 1], found values from {low:.3g} to {high:.3g}; "
            "adapters normalize themselves, pass neither 0..255 nor normalized images"
        )
