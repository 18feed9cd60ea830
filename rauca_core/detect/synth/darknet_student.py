"""A darknet network that learns by :mod:`.student_losses`; a copy of it as it was says what is to be kept."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor, nn

from ..darknet_network import Convolution, DarknetNetwork
from ..interface import DensePredictions
from .network import Truth
from .student_losses import student_losses


class DarknetStudent(nn.Module):
    """The network of a cfg that learns; batch normalization is folded, so it is frozen.

    Attributes:
        network: what learns, all of it.
    """

    def __init__(self, cfg: Path) -> None:
        super().__init__()
        self.network = DarknetNetwork(cfg)
        for layer in self.network.layers:
            if isinstance(layer, Convolution):
                layer.weight.requires_grad_(True)
                layer.bias.requires_grad_(True)
        self._before: list[DarknetNetwork] = []  # in a list: no part of the module, nor of its weights

    @property
    def backbone(self) -> nn.Module:
        """All of it was trained before."""
        return self.network

    def remember(self, before: DarknetNetwork) -> None:
        """Set what :meth:`losses` keeps to: the network as it was before it learnt anything here."""
        self._before = [before.eval().requires_grad_(False)]

    def dense(self, images: Tensor) -> DensePredictions:
        """Predictions as darknet decodes them."""
        found: DensePredictions = self.network(images)
        return found

    def losses(self, images: Tensor, truths: Sequence[Truth], plain: Tensor) -> dict[str, Tensor]:
        """Objectness, class and box of the predictions that answer for a vehicle; what was said before elsewhere.

        Args:
            plain: the images with the vehicles in plain paint: what was said before is said of these.
        """
        found = self.dense(images)
        with torch.no_grad():
            before: DensePredictions = self._before[0].to(plain.device)(plain)
        return student_losses(found, before, truths)
