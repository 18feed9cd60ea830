"""A network of our own that learns by its own losses, and keeps what it found beside the vehicles before it learnt.

The scene knows more of what stands around than the detector did, lorries and buses at the curb, yet to teach it these
would make it another detector: hardening is to change what it says of the vehicles in camouflage, and nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from ..interface import OVERLAP, DensePredictions, Detector
from ..nms import clipped, detections
from .network import Truth
from .student_losses import KEPT, with_kept
from .two_stage import TwoStage


class OwnStudent(nn.Module):
    """One of our own networks that goes on learning.

    Attributes:
        network: what learns.
    """

    def __init__(self, network: nn.Module, before: Detector) -> None:
        """Begin with a network.

        Args:
            before: the detector as it was, which says what is to be kept.
        """
        super().__init__()
        self.network: Any = network
        self._before = [before]  # in a list: no part of the module, nor of its weights

    @property
    def backbone(self) -> nn.Module:
        """The network's own."""
        found: nn.Module = self.network.backbone
        return found

    def dense(self, images: Tensor) -> DensePredictions:
        """The network's own predictions."""
        found: DensePredictions = self.network.dense(images)
        return found

    def losses(self, images: Tensor, truths: Sequence[Truth], plain: Tensor) -> dict[str, Tensor]:
        """The network's own losses, for the vehicles and for all that was found elsewhere before.

        Of Faster R-CNN also ``kept``: what it says of regions on no vehicle, sure of it or not.

        Args:
            plain: the images with the vehicles in plain paint: what is kept was found in these.
        """
        before: Any = self._before[0].to(plain.device)
        found: dict[str, Tensor]
        if isinstance(self.network, TwoStage):
            with torch.no_grad():
                regions = before.network.regions(plain)
                sure = detections(before.network.predictions(regions), KEPT, OVERLAP)
            told = with_kept(clipped(sure, plain), truths)
            found = self.network.losses(images, told, before=regions, vehicles=truths)
        else:
            found = self.network.losses(images, with_kept(before.detect(plain, KEPT), truths))
        return found
