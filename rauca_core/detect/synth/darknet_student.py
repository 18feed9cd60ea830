"""A darknet network that learns: truth where a vehicle stands, everywhere else what it said before.

The data marks vehicles alone. Taught on it as if nothing else existed, a detector of 80 classes would forget most of
them; a copy of the network as it was therefore answers for all predictions that lie on no vehicle (learning without
forgetting; Li and Hoiem, 2017).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..darknet_network import Convolution, DarknetNetwork
from ..interface import DensePredictions
from ..nms import box_iou, generalized_iou
from .network import Truth

ANSWER = 3  # predictions that answer for a vehicle
NEAR = 0.3  # overlap above which a prediction is on a vehicle, and is told nothing unless it answers
BOX_WEIGHT, CLASS_WEIGHT, KEEP_WEIGHT = 1.0, 1.0, 1.0
# Of a probability, in float32: logarithms and their slopes stay finite, and only there. A camouflage that wins drives
# objectness to 1e-6 and below, which is what is to be taught.
LEAST, MOST = 1e-30, 1 - 2**-24


class DarknetStudent(nn.Module):
    """The network of a cfg as a :class:`network.Trainable`; batch normalization is folded, so it is frozen.

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

    def losses(self, images: Tensor, truths: Sequence[Truth]) -> dict[str, Tensor]:
        """Objectness, class and box of the predictions that answer for a vehicle; what was said before elsewhere."""
        found = self.dense(images)
        with torch.no_grad():
            before: DensePredictions = self._before[0].to(images.device)(images)
        parts = [_image_losses(found, before, k, truth) for k, truth in enumerate(truths)]
        vehicles = max(1.0, float(sum(len(t.labels) for t in truths)))
        return {name: torch.stack([part[name] for part in parts]).sum() / vehicles for name in parts[0]}


def _image_losses(found: DensePredictions, before: DensePredictions, k: int, truth: Truth) -> dict[str, Tensor]:
    boxes, objectness, classes = found.boxes[k], found.objectness[k], found.classes[k]
    overlap = box_iou(boxes.detach(), truth.boxes)  # (N, T)
    chosen = overlap.topk(min(ANSWER, len(boxes)), 0).indices  # (ANSWER, T)
    elsewhere = ~(overlap > NEAR).any(1)
    elsewhere[chosen.flatten()] = False
    said, meant = before.objectness[k][elsewhere], before.classes[k][elsewhere]
    kept = cross_entropy(objectness[elsewhere], said).sum()
    kept = kept + (said[:, None] * cross_entropy(classes[elsewhere], meant)).sum()
    labels = functional.one_hot(truth.labels, classes.shape[1]).to(classes).expand(len(chosen), -1, -1)
    hulls = generalized_iou(boxes[chosen], truth.boxes[None])
    share = 1 / len(chosen)
    return {
        "present": share * cross_entropy(objectness[chosen], torch.ones_like(hulls)).sum(),
        "class": CLASS_WEIGHT * share * cross_entropy(classes[chosen], labels).sum(),
        "box": BOX_WEIGHT * share * (1 - hulls).sum(),
        "kept": KEEP_WEIGHT * kept,
    }


def cross_entropy(probability: Tensor, wanted: Tensor) -> Tensor:
    """Of probabilities against wanted ones, elementwise, less the least possible: 0 where the two agree."""
    p, q = probability.clamp(LEAST, MOST), wanted
    least = torch.xlogy(q, q) + torch.xlogy(1 - q, 1 - q)
    return least - torch.xlogy(q, p) - torch.xlogy(1 - q, 1 - p)  # torch's own has no slope below 1e-12
