"""RT-DETR of transformers on our backbone: queries that attend to the image, and no anchors or suppression.

Its losses are transformers': each object is answered for by one prediction, all others say that nothing is there. Boxes
(L1 and generalized IoU) count for the chosen predictions, and classes by the varifocal loss, whose goal is the overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..frameworks.transformers_loading import import_transformers
from ..interface import DensePredictions
from ..nms import box_iou, centered, corners, generalized_iou
from .network import CHANNELS, STRIDES, DarknetBackbone, Truth

WIDTH = 128
HEADS = 4
QUERIES = 60
DECODER_LAYERS = 3
DENOISING = 40  # queries per step that start from a spoiled truth

CLASS_WEIGHT, L1_WEIGHT, GIOU_WEIGHT = 1.0, 5.0, 2.0
CLASS_COST, L1_COST, GIOU_COST = 2.0, 5.0, 2.0
FOCAL_ALPHA, VARIFOCAL_ALPHA, GAMMA = 0.25, 0.75, 2.0

Matches = list[tuple[Tensor, Tensor]]
"""Per image: indices of predictions, and of the objects that they answer for."""


class Transformer(nn.Module):
    """RT-DETR (Zhao et al., 2024): a hybrid encoder of three strides, the best of its features as queries, a decoder.

    Attention to the image is deformable, as in Deformable DETR, and runs in plain torch.
    """

    def __init__(self, backbone: DarknetBackbone, classes: int) -> None:
        super().__init__()
        self.detr = _detr(backbone, classes)

    @property
    def backbone(self) -> DarknetBackbone:
        """The convolutions that it begins with."""
        return self.detr.backbone.body

    def losses(self, images: Tensor, truths: Sequence[Truth]) -> dict[str, Tensor]:
        """Losses of the encoder's proposals, of every decoder layer, and of the denoising queries of each.

        The spoiled truths are drawn by torch's own generator.
        """
        goals = [Truth(centered(t.boxes) / images.shape[3], t.labels) for t in truths]
        labels = [{"class_labels": t.labels, "boxes": t.boxes} for t in goals]
        found = self.detr(images, labels=labels)
        objects = max(1.0, float(sum(len(t.labels) for t in goals)))
        logits, boxes = found.intermediate_logits.float(), found.intermediate_reference_points.float()
        losses: list[dict[str, Tensor]] = []
        meta = found.denoising_meta_values
        if meta is not None:
            (spoiled_logits, logits), (spoiled_boxes, boxes) = (
                x.split(meta["dn_num_split"], 2) for x in (logits, boxes)
            )
            groups = meta["dn_num_group"]
            known = [
                (chosen, torch.arange(len(t.labels), device=chosen.device).repeat(groups))
                for chosen, t in zip(meta["dn_positive_idx"], goals, strict=True)
            ]
            losses += [
                layer_losses(spoiled_logits[:, k], spoiled_boxes[:, k], goals, known, objects * groups)
                for k in range(DECODER_LAYERS)
            ]
        layers = [(logits[:, k], boxes[:, k]) for k in range(DECODER_LAYERS)]
        layers.append((found.enc_topk_logits.float(), found.enc_topk_bboxes.float()))
        losses += [layer_losses(a, b, goals, match(a, b, goals), objects) for a, b in layers]
        return {name: torch.stack([layer[name] for layer in losses]).sum() for name in losses[0]}

    def dense(self, images: Tensor) -> DensePredictions:
        """Every query of the last layer; objectness is one, classes are independent probabilities.

        Where the queries start takes no gradient, as in training.
        """
        found = self.detr(images)
        boxes = corners(found.intermediate_reference_points[:, -1]) * images.shape[3]
        scores = found.intermediate_logits[:, -1].sigmoid()
        return DensePredictions(boxes, torch.ones_like(boxes[..., 0]), scores)


def _detr(backbone: DarknetBackbone, classes: int) -> Any:
    """transformers' model, its backbone replaced by ours."""
    transformers: Any = import_transformers()
    config = transformers.RTDetrConfig(
        # A stand-in that has our features' widths.
        backbone_config=transformers.RTDetrResNetConfig(
            embedding_size=8, hidden_sizes=[8, *CHANNELS], depths=[1] * 4, layer_type="basic", out_indices=[2, 3, 4]
        ),
        encoder_hidden_dim=WIDTH, encoder_in_channels=list(CHANNELS), feat_strides=list(STRIDES), encoder_layers=1,
        encoder_ffn_dim=2 * WIDTH, encoder_attention_heads=HEADS, hidden_expansion=0.5, d_model=WIDTH,
        num_queries=QUERIES, decoder_in_channels=[WIDTH] * 3, decoder_ffn_dim=3 * WIDTH, decoder_layers=DECODER_LAYERS,
        decoder_attention_heads=HEADS, decoder_n_points=4, num_denoising=DENOISING, num_labels=classes,
        anchor_image_size=None, activation_function="relu",
    )  # fmt: skip
    model: Any = transformers.RTDetrForObjectDetection(config).model
    model.backbone = _Backbone(backbone)
    return model


class _Backbone(nn.Module):
    """Our backbone as transformers calls a backbone; its masks say which pixels are padding, of which we have none."""

    def __init__(self, backbone: DarknetBackbone) -> None:
        super().__init__()
        self.body = backbone  # of this name in weights files

    def forward(self, images: Tensor, mask: Tensor) -> list[tuple[Tensor, None]]:
        return [(level, None) for level in self.body(images)]


@torch.no_grad()
def match(logits: Tensor, boxes: Tensor, truths: Sequence[Truth]) -> Matches:
    """The cheapest assignment of every image; of more objects than predictions, the largest are answered for.

    Args:
        logits: (B, N, C).
        boxes: (B, N, 4) center and size, fractions of the image.
        truths: boxes likewise.
    """
    from scipy.optimize import linear_sum_assignment  # not at the top: only who trains needs it

    matches = []
    for one_logits, one_boxes, truth in zip(logits, boxes, truths, strict=True):
        area = truth.boxes[:, 2:].prod(1)
        which = area.topk(min(len(area), len(one_boxes))).indices.sort().values
        labels, goals = truth.labels[which], truth.boxes[which]
        probability = one_logits.sigmoid()[:, labels]
        present = FOCAL_ALPHA * (1 - probability) ** GAMMA * -(probability + 1e-8).log()
        absent = (1 - FOCAL_ALPHA) * probability**GAMMA * -(1 - probability + 1e-8).log()
        apart = torch.cdist(one_boxes, goals, p=1)
        overlap = generalized_iou(corners(one_boxes)[:, None], corners(goals)[None])
        cost = CLASS_COST * (present - absent) + L1_COST * apart - GIOU_COST * overlap
        _, answering = linear_sum_assignment(cost.T.double().cpu().numpy())
        chosen = torch.from_numpy(answering).to(one_boxes.device)
        matches.append((chosen, which))
    return matches


def layer_losses(
    logits: Tensor, boxes: Tensor, truths: Sequence[Truth], matches: Matches, objects: float
) -> dict[str, Tensor]:
    """Losses of one layer's predictions, divided by the number of ``objects``; shapes as of :func:`match`."""
    image = torch.cat([torch.full_like(chosen, k) for k, (chosen, _) in enumerate(matches)])
    place = image, torch.cat([chosen for chosen, _ in matches])
    goal = torch.cat([t.boxes[which] for t, (_, which) in zip(truths, matches, strict=True)])
    labels = torch.cat([t.labels[which] for t, (_, which) in zip(truths, matches, strict=True)])
    found = boxes[place]
    overlap = box_iou(corners(found.detach())[:, None], corners(goal)[:, None])[:, 0, 0]
    hot, wanted = torch.zeros_like(logits), torch.zeros_like(logits)
    hot[*place, labels], wanted[*place, labels] = 1.0, overlap
    weight = VARIFOCAL_ALPHA * logits.detach().sigmoid() ** GAMMA * (1 - hot) + wanted
    classes = functional.binary_cross_entropy_with_logits(logits, wanted, weight, reduction="sum")
    hulls = generalized_iou(corners(found), corners(goal))
    return {
        "classes": CLASS_WEIGHT * classes / objects,
        "l1": L1_WEIGHT * (found - goal).abs().sum() / objects,
        "giou": GIOU_WEIGHT * (1 - hulls).sum() / objects,
    }
