"""torchvision's detection models behind the common interface."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.rnn import pad_sequence

from ...contract import RaucaError
from ..families import Resolved
from ..foreign import changed
from ..interface import OVERLAP, DensePredictions, Detections
from ..nms import SinglePassDetector
from ..synth.network import Truth
from .checkpoint import fill, fingerprint, read_state
from .torchvision_ops import import_torchvision

Head = Callable[[Any, Any, Mapping[str, Tensor]], DensePredictions]


def two_stage(model: Any, images: Any, features: Mapping[str, Tensor]) -> DensePredictions:
    """Every proposal after the box head, with the box that belongs to its most probable category.

    Proposals carry no gradient, as in the framework: features do, through the region pooling. Images with fewer
    proposals than others are filled up with empty boxes of objectness 0.
    """
    proposals, _ = model.rpn(images, features)
    heads = model.roi_heads
    pooled = heads.box_head(heads.box_roi_pool(features, proposals, images.image_sizes))
    logits, offsets = heads.box_predictor(pooled)
    boxes = heads.box_coder.decode(offsets, proposals).reshape(-1, logits.shape[1], 4)
    classes = logits.softmax(-1)
    best = 1 + classes[:, 1:].argmax(1)
    boxes = _clip(boxes[torch.arange(len(best), device=best.device), best], images)
    counts = [len(one) for one in proposals]
    padded = [pad_sequence(one.split(counts), batch_first=True) for one in (boxes, classes)]
    objectness = pad_sequence([boxes.new_ones(count) for count in counts], batch_first=True)
    return DensePredictions(padded[0], objectness, padded[1])


def retinanet(model: Any, images: Any, features: Mapping[str, Tensor]) -> DensePredictions:
    """Every anchor; categories are independent of one another (sigmoid)."""
    boxes, found = _anchored(model, images, features)
    return DensePredictions(boxes, torch.ones_like(boxes[..., 0]), found["cls_logits"].sigmoid())


def fcos(model: Any, images: Any, features: Mapping[str, Tensor]) -> DensePredictions:
    """Every point; torchvision's score, sqrt(P(class) * centerness), is the product of ``objectness`` and ``classes``.

    The root is taken in the exponent, where its slope stays finite when a probability rounds to 0.
    """
    boxes, found = _anchored(model, images, features)
    centerness, classes = ((functional.logsigmoid(found[key]) / 2).exp() for key in ("bbox_ctrness", "cls_logits"))
    return DensePredictions(boxes, centerness[..., 0], classes)


def ssd(model: Any, images: Any, features: Mapping[str, Tensor]) -> DensePredictions:
    """Every default box; categories exclude one another (softmax)."""
    boxes, found = _anchored(model, images, features)
    return DensePredictions(boxes, torch.ones_like(boxes[..., 0]), found["cls_logits"].softmax(-1))


def _anchored(model: Any, images: Any, features: Mapping[str, Tensor]) -> tuple[Tensor, dict[str, Tensor]]:
    """Decoded boxes (B, N, 4) and the head's outputs (B, N, ...) of a model without a second stage."""
    levels = list(features.values())
    found: dict[str, Tensor] = model.head(levels)
    anchors = model.anchor_generator(images, levels)
    decode = getattr(model.box_coder, "decode_single", model.box_coder.decode)
    boxes = torch.stack([decode(*one) for one in zip(found["bbox_regression"], anchors, strict=True)])
    return _clip(boxes, images), found


def _clip(boxes: Tensor, images: Any) -> Tensor:
    """Images of a batch are of one size."""
    height, width = images.image_sizes[0]
    return boxes.clamp(min=0).minimum(boxes.new_tensor([width, height, width, height]))


# torchvision's models take a shorter side of 800 pixels and a longer one of at most 1333.
_LONGEST = 1333 / 800


class TorchvisionDetector(SinglePassDetector):
    """Faster R-CNN, RetinaNet, FCOS or SSD of torchvision.

    ``detect`` is torchvision's own post-processing with the caller's two thresholds; its other limits are the model's
    (at most 100 detections per image, for one). ``dense`` keeps what that post-processing starts from: all proposals
    after the box head, or all anchors, see :mod:`rauca_core.detect.frameworks.torchvision_detector`. Where a softmax
    shares one probability between the categories and the background, ``objectness`` is 1 and ``classes`` are the
    categories' shares, so their product is torchvision's score throughout.
    """

    def __init__(self, name: str, model: nn.Module, class_names: tuple[str, ...]) -> None:
        """Take a model over, in evaluation mode; its weights no longer learn.

        Args:
            model: torchvision's ``FasterRCNN``, ``RetinaNet``, ``FCOS`` or ``SSD``, with any backbone.
            class_names: without the background. RetinaNet and FCOS may have a column for the background or none.

        Raises:
            RaucaError: torchvision is missing, another kind of model, a number of names that does not fit.
        """
        self._head, self._thresholds_of, columns, has_background = _anatomy(name, model)
        self._skipped = columns - len(class_names)
        if self._skipped not in ((1,) if has_background else (0, 1)):
            raise RaucaError(
                f"{name}: the network predicts {columns - has_background} classes, {len(class_names)} names were "
                "given; write its own, one a line, into a .names file beside the weights, or give names"
            )
        self.name, self.class_names = name, class_names
        self.network = model.eval().requires_grad_(False)
        self.fingerprint = fingerprint(model, class_names)

    def _predict(self, images: Tensor) -> DensePredictions:
        batch, _ = self.network.transform(list(images))
        features = self.network.backbone(batch.tensors)
        found = self._head(self.network, batch, {"0": features} if isinstance(features, Tensor) else features)
        height, width = batch.image_sizes[0]
        scale = found.boxes.new_tensor([images.shape[3] / width, images.shape[2] / height] * 2)
        return DensePredictions(found.boxes * scale, found.objectness, found.classes[..., self._skipped :])

    @property
    def side(self) -> int:
        """The shorter side that images are scaled to, pixels."""
        transform = self.network.transform
        return int((transform.fixed_size or transform.min_size)[0])

    def losses(self, images: Tensor, truths: Sequence[Truth]) -> dict[str, Tensor]:
        """torchvision's own losses, to be summed, of a network in training mode; boxes in the images' pixels."""
        targets = [{"boxes": one.boxes, "labels": one.labels + self._skipped} for one in truths]
        found: dict[str, Tensor] = self.network(list(images), targets)
        return found

    @torch.inference_mode()
    def detect(
        self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = OVERLAP
    ) -> list[Detections]:
        """Final detections per image, boxes clipped to it; see :class:`rauca_core.detect.Detector`."""
        images = self._checked(images, waits=True)
        detections = []
        with changed(self._thresholds_of, score_thresh=score_threshold, nms_thresh=iou_threshold):
            for found in self.network(list(images)):
                labels = found["labels"] - self._skipped
                named = labels >= 0
                detections.append(Detections(found["boxes"][named], found["scores"][named], labels[named]))
        return detections

    def _checked(self, images: Tensor, waits: bool = False) -> Tensor:
        images = super()._checked(images, waits)
        transform = self.network.transform
        shorter, longer = sorted(images.shape[2:])
        if transform.fixed_size is None and shorter * transform.max_size < longer:  # scaled, thinner than one pixel
            raise RaucaError(f"{self.name}: images of {images.shape[3]} x {images.shape[2]} pixels are too narrow")
        return images


def load(found: Resolved, size: int | None) -> TorchvisionDetector:
    """A model of ``torchvision.models.detection``, by its name there, with ``.safetensors`` or torch's ``.pth``.

    The weights tell how many classes there are. The two MobileNet Faster R-CNNs have tensors of the same shapes: only
    the file's name tells them apart. ``size`` is the shorter side that images are scaled to, pixels (the longer one at
    most 5/3 of it); SSDs take none but their own.
    """
    build = getattr(import_torchvision().models.detection, found.network)
    state = read_state(found.files[0])
    columns = _columns(state) or len(found.names) + 1
    with torch.random.fork_rng(devices=[]):  # what it draws is overwritten
        model = build(weights=None, weights_backbone=None, num_classes=columns)
    fill(model, state, found.files[0])
    if size is not None:
        _set_size(found.name, model, size)
    return TorchvisionDetector(found.name, model, found.names)


# The tensor with a value per anchor and class, beside that with four per anchor, of each kind of head.
_PER_ANCHOR = {
    "head.classification_head.cls_logits.bias": "head.regression_head.bbox_reg.bias",
    "head.classification_head.module_list.0.bias": "head.regression_head.module_list.0.bias",
    "head.classification_head.module_list.0.1.bias": "head.regression_head.module_list.0.1.bias",
}


def _columns(state: Mapping[str, Tensor]) -> int:
    """How many classes weights tell apart, a background among them; 0 where they do not say."""
    if "roi_heads.box_predictor.cls_score.bias" in state:
        return state["roi_heads.box_predictor.cls_score.bias"].numel()
    counts = [(state[a].numel(), state[b].numel()) for a, b in _PER_ANCHOR.items() if a in state and b in state]
    return 4 * counts[0][0] // max(counts[0][1], 1) if counts else 0


def _set_size(name: str, model: Any, size: int) -> None:
    if model.transform.fixed_size is not None:
        raise RaucaError(f"{name}: its input size is its own; leave size out")
    if size < 32:
        raise RaucaError(f"{name}: input size {size} must be at least 32 pixels")
    model.transform.min_size = (size,)
    model.transform.max_size = round(size * _LONGEST)


def is_torchvision(model: nn.Module) -> bool:
    """Whether a model is one of those that have a gradient here, or derived from one."""
    kinds = {
        kind.__name__ for kind in type(model).__mro__ if kind.__module__.startswith("torchvision.models.detection")
    }
    return bool(kinds & {"FasterRCNN", "RetinaNet", "FCOS", "SSD"})


def _anatomy(name: str, model: Any) -> tuple[Head, Any, int, bool]:
    """How to decode a model, which module holds its thresholds, its class columns and whether it has a background."""
    models = import_torchvision().models.detection
    if isinstance(model, models.FasterRCNN):
        return two_stage, model.roi_heads, model.roi_heads.box_predictor.cls_score.out_features, True
    if isinstance(model, models.RetinaNet):
        return retinanet, model, model.head.classification_head.num_classes, False
    if isinstance(model, models.FCOS):
        return fcos, model, model.head.classification_head.num_classes, False
    if isinstance(model, models.ssd.SSD):
        return ssd, model, model.head.classification_head.num_columns, True
    raise RaucaError(f"{name}: a {type(model).__name__} is none of torchvision's FasterRCNN, RetinaNet, FCOS and SSD")
