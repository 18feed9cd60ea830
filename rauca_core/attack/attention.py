"""Where a detector looks, and a loss that scatters it: the model attention of DAS.

The map is Grad-CAM's: channels of the backbone's last features, weighted by how much each raises the vehicle's score.
Regions of positive attention that hang together are costly when they are strong and large, so that what is left of
the attention is weak and in small pieces.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from ..contract import RaucaError
from ..detect import Detector
from ..detect.heads import Head, precise
from ..detect.layers import Route
from ..detect.network import DarknetNetwork

SCORE_EDGE = 1e-6  # from 0 and 1: beyond, the log-odds of a score have no slope


def attention_layer(detector: Detector) -> nn.Module:
    """The module whose output (B, C, h, w) attention is read from.

    A detector may name it as ``attention_layer``. Of a darknet network it is the last layer that all heads share.

    Raises:
        RaucaError: neither of the two.
    """
    named, network = getattr(detector, "attention_layer", None), getattr(detector, "network", None)
    if isinstance(named, nn.Module):
        return named
    if isinstance(network, DarknetNetwork):
        layers = list(network.layers)
        first = next(i for i, layer in enumerate(layers) if isinstance(layer, Head))
        after = next((layer for layer in layers[first:] if isinstance(layer, Route)), None)
        return layers[first - 2 if after is None else after.sources[0]]
    raise RaucaError(f"{detector.name}: its attention cannot be read; choose a yolov2, yolov3 or yolov4")


@contextlib.contextmanager
def watching(layer: nn.Module | None) -> Iterator[list[Tensor]]:
    """What the layer puts out while the block runs, the latest last; nothing without a layer."""
    seen: list[Tensor] = []

    def keep(_module: nn.Module, _given: Any, output: Tensor) -> None:
        seen.append(output)

    handle = None if layer is None else layer.register_forward_hook(keep)
    try:
        yield seen
    finally:
        if handle is not None:
            handle.remove()


def attention_map(score: Tensor, features: Tensor) -> Tensor:
    """Grad-CAM (B, h, w) of the log-odds of ``score`` (B,), differentiable by way of ``features`` (B, C, h, w).

    The channels' weights are constants of it, as published; but sums of their slopes, not means: a classifier pools
    all cells, a detector's score hangs on a few, and its map would all but vanish. Positive where the vehicle's score
    comes from.
    """
    slopes = None
    if score.requires_grad:
        evidence = torch.logit(score.clamp(SCORE_EDGE, 1 - SCORE_EDGE)).sum()
        (slopes,) = torch.autograd.grad(evidence, features, retain_graph=True, allow_unused=True)
    features = precise(features)  # after the slopes: what a network in bfloat16 reads is not this copy
    weights = torch.zeros_like(features) if slopes is None else precise(slopes)
    return (features * weights.sum((2, 3), keepdim=True)).sum(1)


def dispersed_attention(score: Tensor, features: Tensor) -> Tensor:
    """DAS's loss (B,): the mean over connected regions of ``sum(tanh attention) / (cells + 1 - cells of the region)``.

    Cells with an edge in common hang together.
    """
    strength = attention_map(score, features).tanh()
    return torch.stack([_scatter(one) for one in strength])


def _scatter(strength: Tensor) -> Tensor:
    import cv2  # here: only this objective needs it

    positive = (strength.detach() > 0).cpu().numpy().astype(np.uint8)
    count, labels = cv2.connectedComponents(positive, connectivity=4)
    if count <= 1:  # the background alone
        return (strength * 0.0).sum()
    regions = torch.from_numpy(labels.astype(np.int64)).to(strength.device).ravel()
    sums = strength.new_zeros(count).index_add(0, regions, strength.ravel())
    sizes = torch.bincount(regions, minlength=count)
    return (sums / (strength.numel() + 1 - sizes))[1:].mean()
