"""RT-DETR of transformers on our backbone: queries that attend to the image, and no anchors or suppression."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor, nn

from ..frameworks.transformers_loading import import_transformers
from ..interface import DensePredictions
from ..nms import centered, corners
from .network import CHANNELS, STRIDES, DarknetBackbone, Truth

WIDTH = 128
HEADS = 4
QUERIES = 60
DECODER_LAYERS = 3
DENOISING = 40  # queries per step that start from a spoiled truth


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
        """transformers' losses of the encoder's proposals, of every decoder layer, and of its denoising queries.

        Each object is answered for by one prediction, all others say that nothing is there. Boxes (L1 and generalized
        IoU) count for the chosen predictions, and classes by the varifocal loss, whose goal is the overlap. The spoiled
        truths are drawn by torch's own generator.
        """
        labels = [{"class_labels": t.labels, "boxes": centered(t.boxes) / images.shape[3]} for t in truths]
        found = self.detr(images, labels=labels)
        logits, boxes = found.intermediate_logits.float(), found.intermediate_reference_points.float()
        outputs: dict[str, Any] = {}
        if (meta := found.denoising_meta_values) is not None:
            (spoiled, logits), (spoiled_boxes, boxes) = (x.split(meta["dn_num_split"], 2) for x in (logits, boxes))
            outputs = {"denoising_meta_values": meta, "dn_auxiliary_outputs": _layers(spoiled, spoiled_boxes)}
        *earlier, last = _layers(logits, boxes)
        first = {"logits": found.enc_topk_logits.float(), "pred_boxes": found.enc_topk_bboxes.float()}
        criterion = importlib.import_module("transformers.loss.loss_rt_detr").RTDetrLoss(self.detr.config)
        losses: dict[str, Tensor] = criterion({**last, **outputs, "auxiliary_outputs": [*earlier, first]}, labels)
        return losses

    def dense(self, images: Tensor) -> DensePredictions:
        """Every query of the last layer; objectness is one, classes are independent probabilities.

        Where the queries start takes no gradient, as in training.
        """
        found = self.detr(images)
        boxes = corners(found.intermediate_reference_points[:, -1]) * images.shape[3]
        scores = found.intermediate_logits[:, -1].sigmoid()
        return DensePredictions(boxes, torch.ones_like(boxes[..., 0]), scores)


def _layers(logits: Tensor, boxes: Tensor) -> list[dict[str, Tensor]]:
    """Predictions (B, layers, N, ...), layer by layer."""
    pairs = zip(logits.unbind(1), boxes.unbind(1), strict=True)
    return [{"logits": one, "pred_boxes": other} for one, other in pairs]


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
