"""A running mean of a network's weights: nearer to the minimum than the last step's, and steadier."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import torch
from torch import Tensor, nn

PREFIX = "average."


class WeightAverage:
    """The exponential mean of all parameters; buffers stay the network's own.

    Args:
        net: whose parameters are followed.
        decay: weight of the past at every step, in [0, 1); early on it is less, as there is little past. At 0 the mean
            is the network itself.
    """

    def __init__(self, net: nn.Module, decay: float) -> None:
        self._net, self._decay = net, decay
        self._mean = {name: p.detach().clone() for name, p in net.named_parameters()} if decay else {}

    @torch.no_grad()
    def update(self, steps: int) -> None:
        """Take the weights in after ``steps`` steps."""
        past = min(self._decay, (1 + steps) / (10 + steps))
        for name, p in self._net.named_parameters():
            if name in self._mean:
                self._mean[name].lerp_(p, 1 - past)

    @contextlib.contextmanager
    def shown(self) -> Iterator[None]:
        """Within, the network has its mean weights."""
        self._exchange()
        try:
            yield
        finally:
            self._exchange()

    def tensors(self) -> dict[str, Tensor]:
        """For a checkpoint."""
        return {PREFIX + name: value for name, value in self._mean.items()}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        """Put back what :meth:`tensors` gave."""
        for name, value in self._mean.items():
            value.copy_(tensors[PREFIX + name])

    @torch.no_grad()
    def _exchange(self) -> None:
        for name, p in self._net.named_parameters():
            if name in self._mean:
                own = p.clone()
                p.copy_(self._mean[name])
                self._mean[name].copy_(own)
