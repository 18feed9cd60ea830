"""Faster R-CNN of torchvision on our backbone: a region proposal network, RoIAlign, and a head per region."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.rnn import pad_sequence

from ..frameworks.torchvision_ops import import_torchvision
from ..interface import DensePredictions
from .network import CHANNELS, STRIDES, DarknetBackbone, Truth
from .student_losses import KEEP_WEIGHT, on_vehicle

WIDTH = 96  # of the feature pyramid
HIDDEN = 384  # of the head
ANCHOR_SIDES = ((16.0, 32.0), (52.0, 84.0), (128.0, 200.0))  # pixels, per stride
ASPECTS = (0.5, 1.0, 2.0)
POOLED = 7
PROPOSALS = 100
REGIONS = 64  # per image that a step learns from


@dataclass(frozen=True, eq=False)
class Regions:
    """What a network says of the regions that it proposes in B images.

    Attributes:
        boxes: B of (K_b, 4), pixels.
        logits: (sum of K_b, 1 + classes), the background's first.
        offsets: of each class's box, as torchvision codes them.
    """

    boxes: list[Tensor]
    logits: Tensor
    offsets: Tensor


class TwoStage(nn.Module):
    """Faster R-CNN (Ren et al., 2015) with a feature pyramid of three levels.

    Attributes:
        classes: how many, without the background.
    """

    def __init__(self, backbone: DarknetBackbone, classes: int) -> None:
        super().__init__()
        self.classes = classes
        self.body = backbone  # of this name in weights files
        self.pyramid, self.rpn, self.roi_heads = _parts(classes)

    @property
    def backbone(self) -> DarknetBackbone:
        """The convolutions that it begins with."""
        return self.body

    def losses(
        self, images: Tensor, truths: Sequence[Truth], before: Regions | None = None, vehicles: Sequence[Truth] = ()
    ) -> dict[str, Tensor]:
        """The four losses of Faster R-CNN: objectness and box of the proposals, class and box of the regions.

        Regions to learn from are drawn by torch's own generator.

        Args:
            images: (B, 3, H, W) sRGB in [0, 1].
            truths: B of them, boxes in the images' pixels.
            before: what an earlier state of this network says of these images with the vehicles in plain paint. With
                it there is a fifth loss, ``kept``, see :meth:`_kept`.
            vehicles: those of the truths that ``kept`` leaves out.
        """
        targets = [{"boxes": t.boxes, "labels": t.labels + 1} for t in truths]  # 0 is torchvision's background
        features, frame = self._features(images)
        proposals, first = self.rpn(frame, features, targets)
        _, second = self.roi_heads(features, proposals, frame.image_sizes, targets)
        kept = {} if before is None else {"kept": self._kept(features, frame, before, vehicles)}
        return {**first, **second, **kept}

    def _kept(self, features: dict[str, Tensor], frame: Any, before: Regions, vehicles: Sequence[Truth]) -> Tensor:
        """How far this network is from an earlier one in what it says of regions on no vehicle; 0 where they agree.

        Kullback-Leibler's divergence between the classes of both, the background among them, summed over all regions
        that the earlier one proposes and divided by the number of vehicles, as in `student_losses`.
        """
        elsewhere = [~on_vehicle(boxes, truth.boxes) for boxes, truth in zip(before.boxes, vehicles, strict=True)]
        regions = [boxes[free] for boxes, free in zip(before.boxes, elsewhere, strict=True)]
        meant = before.logits[torch.cat(elsewhere)].float().log_softmax(-1)
        said = self._said(features, regions, frame)[0].float().log_softmax(-1)
        count = max(1, sum(len(truth.labels) for truth in vehicles))
        return KEEP_WEIGHT * functional.kl_div(said, meant, reduction="sum", log_target=True) / count

    def regions(self, images: Tensor) -> Regions:
        """What the network says of the regions that it proposes; in evaluation mode.

        Where the proposals lie takes no gradient, as in training.
        """
        features, frame = self._features(images)
        proposals, _ = self.rpn(frame, features)
        return Regions(proposals, *self._said(features, proposals, frame))

    def dense(self, images: Tensor) -> DensePredictions:
        """Every class of every proposal as a prediction, see :meth:`predictions`."""
        return self.predictions(self.regions(images))

    def predictions(self, regions: Regions) -> DensePredictions:
        """Every class of every proposal as a prediction of its own, for each class has a box of its own.

        N is proposals x classes; ``classes`` holds the softmax probability in the prediction's own column and 0
        elsewhere; the background's share is left out.
        """
        boxes = self.roi_heads.box_coder.decode(regions.offsets, regions.boxes)[:, 1:]
        scores = regions.logits.softmax(-1)[:, 1:]
        count = [len(p) for p in regions.boxes]
        # images with fewer proposals are filled up with empty boxes of probability 0
        padded = [
            pad_sequence([one.flatten(0, 1) for one in values.split(count)], batch_first=True)
            for values in (boxes, torch.diag_embed(scores))
        ]
        ones = [padded[0].new_ones(n * self.classes) for n in count]
        return DensePredictions(padded[0], pad_sequence(ones, batch_first=True), padded[1])

    def _said(self, features: dict[str, Tensor], regions: list[Tensor], frame: Any) -> tuple[Tensor, Tensor]:
        """Of all regions (K, 4): logits (K, 1 + classes), the background's first, and offsets of each class's box."""
        heads = self.roi_heads
        pooled = heads.box_head(heads.box_roi_pool(features, regions, frame.image_sizes))
        found: tuple[Tensor, Tensor] = heads.box_predictor(pooled)
        return found

    def _features(self, images: Tensor) -> tuple[dict[str, Tensor], Any]:
        image_list = importlib.import_module("torchvision.models.detection.image_list")
        levels = {str(i): level for i, level in enumerate(self.body(images))}
        side = images.shape[2], images.shape[3]
        return self.pyramid(levels), image_list.ImageList(images, [side] * len(images))


class _RegionHead(nn.Module):
    """(K, C, 7, 7) pooled features -> (K, HIDDEN)."""

    def __init__(self) -> None:
        super().__init__()
        self.squeeze = nn.Conv2d(WIDTH, WIDTH, 3)
        self.first = nn.Linear(WIDTH * (POOLED - 2) ** 2, HIDDEN)
        self.second = nn.Linear(HIDDEN, HIDDEN)

    def forward(self, x: Tensor) -> Tensor:
        x = functional.relu(self.first(functional.relu(self.squeeze(x)).flatten(1)))
        return functional.relu(self.second(x))


def _parts(classes: int) -> tuple[nn.Module, Any, Any]:
    """Feature pyramid, region proposal network and region heads, of torchvision."""
    import_torchvision()
    ops = importlib.import_module("torchvision.ops")
    anchors, rpn, heads, faster = (
        importlib.import_module(f"torchvision.models.detection.{name}")
        for name in ("anchor_utils", "rpn", "roi_heads", "faster_rcnn")
    )
    generator = anchors.AnchorGenerator(ANCHOR_SIDES, (ASPECTS,) * len(STRIDES))
    network = rpn.RegionProposalNetwork(
        generator,
        rpn.RPNHead(WIDTH, generator.num_anchors_per_location()[0]),
        fg_iou_thresh=0.6,
        bg_iou_thresh=0.3,
        batch_size_per_image=128,
        positive_fraction=0.5,
        pre_nms_top_n={"training": 300, "testing": 300},
        post_nms_top_n={"training": 2 * PROPOSALS, "testing": PROPOSALS},
        nms_thresh=0.7,
    )
    names = [str(i) for i in range(len(STRIDES))]
    # A side of 96 pixels is pooled from stride 16: our images are a third of COCO's.
    pool = ops.MultiScaleRoIAlign(names, POOLED, sampling_ratio=2, canonical_scale=96, canonical_level=4)
    regions = heads.RoIHeads(
        pool, _RegionHead(), faster.FastRCNNPredictor(HIDDEN, classes + 1),
        0.5, 0.5, REGIONS, 0.25, None, 0.005, 0.45, 100,
    )  # fmt: skip
    return ops.FeaturePyramidNetwork(list(CHANNELS), WIDTH), network, regions
