"""A model of torchvision, transformers or MMDetection that learns by its framework's own losses.

Those losses know how the model's predictions answer for objects: anchors, regions, points, or queries of which one is
matched to each object. The data marks vehicles alone; what the model said of everything else before it learnt is
therefore truth as well (learning without forgetting; Li and Hoiem, 2017; of detectors, Shmelkov et al., 2017).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import torch
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _BatchNorm

from ..interface import DensePredictions, Detector
from .network import Truth
from .student_losses import KEPT, with_kept


class FrameworkDetector(Detector, Protocol):
    """An adapter of a framework's model.

    Attributes:
        network: the framework's own module.
    """

    network: Any

    @property
    def side(self) -> int:
        """The shorter side that images are scaled to, pixels."""
        ...

    def losses(self, images: Tensor, truths: Sequence[Truth]) -> dict[str, Tensor]:
        """The framework's losses of a network in training mode, to be summed."""
        ...


class FrameworkStudent(nn.Module):
    """A framework's model that learns; batch normalization stays as it is.

    Attributes:
        names: of the parameters that learn, in the model.
        tensors: these parameters, which the model shares: all that this module's state holds.
    """

    def __init__(self, detector: FrameworkDetector, before: Detector) -> None:
        """Begin with the detector's weights, which learn in place.

        Args:
            before: the detector as it was, which says what is to be kept.
        """
        super().__init__()
        network = detector.network.requires_grad_(True)
        network.train()  # some freeze their first layers in it
        fixed = {id(p) for one in network.modules() if isinstance(one, _BatchNorm) for p in one.parameters()}
        learnt = {name: p for name, p in network.named_parameters() if p.requires_grad and id(p) not in fixed}
        for one in network.parameters():
            one.requires_grad_(id(one) not in fixed and one.requires_grad)
        self.names = tuple(learnt)
        self.tensors = nn.ParameterList(learnt.values())
        self._held = [detector, before]  # in a list: no part of the module, nor of its state

    @property
    def detector(self) -> FrameworkDetector:
        """The detector that learns."""
        found: Any = self._held[0]
        return found

    @property
    def backbone(self) -> nn.Module:
        """All of it was trained before."""
        return self

    def train(self, mode: bool = True) -> FrameworkStudent:
        """Statistics of batch normalization stay, whatever the mode."""
        self.detector.network.train(mode)
        for module in self.detector.network.modules():
            if isinstance(module, _BatchNorm):
                module.eval()
        return super().train(mode)

    def learnt(self) -> dict[str, Tensor]:
        """The tensors by their names in the model."""
        return dict(zip(self.names, self.tensors, strict=True))

    def dense(self, images: Tensor) -> DensePredictions:
        """Predictions in sRGB images (B, 3, H, W) in [0, 1], as the detector's."""
        return self.detector.dense(images)

    def losses(self, images: Tensor, truths: Sequence[Truth], plain: Tensor) -> dict[str, Tensor]:
        """The framework's losses for the vehicles and for all that was found elsewhere before, in single precision.

        Args:
            plain: the images with the vehicles in plain paint, in which was found what is kept.
        """
        told = with_kept(self._held[1].to(plain.device).detect(plain, KEPT), truths)
        with torch.autocast(images.device.type, enabled=False):  # their matching asks for it
            return self.detector.losses(images, told)

    def _apply(self, fn: Callable[..., Any], recurse: bool = True) -> FrameworkStudent:
        """To another device goes the whole model, not its parameters alone."""
        self.detector.network._apply(fn)
        return super()._apply(fn, recurse)
