"""DETR and its descendants, as transformers implements them, behind the common interface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from ..batch_norm import freeze_batch_norms
from ..classes import canonical, require_names
from ..families import Resolved
from ..interface import DensePredictions, Detections
from ..nms import SinglePassDetector, centered, corners, of_queries
from ..synth.network import Truth
from .checkpoint import fingerprint
from .scaling import Scaling, read_scaling
from .transformers_loading import Family, family_of, load_model

# Of a configuration, but not of what the model computes (its backbone shows in its structure).
_ORIGIN = frozenset(
    {"_name_or_path", "architectures", "dtype", "torch_dtype", "transformers_version", "use_timm_backbone"}
)


class TransformersDetector(SinglePassDetector):
    """DETR, Deformable DETR, RT-DETR, RT-DETRv2 or YOLOS.

    ``dense`` gives every query: ``objectness`` is 1 and ``classes`` are the model's scores (DETR, YOLOS: softmax
    without "no object"; the others: one sigmoid per category). These detectors are trained to say each object once and
    have no non-maximum suppression: ``detect`` is transformers' ``post_process_object_detection``, ``iou_threshold``
    unused.

    Attributes:
        scaling: resizing and normalization.
    """

    def __init__(
        self,
        name: str,
        model: Any,
        class_names: tuple[str, ...] | None = None,
        size: int | None = None,
        scaling: Scaling | None = None,
    ) -> None:
        """Take a model over, in evaluation mode; its weights no longer learn.

        Args:
            model: ``DetrForObjectDetection``, ``DeformableDetrForObjectDetection`` or RT-DETR's.
            class_names: None for those of the model's configuration.
            size: shorter side that images are scaled to (RT-DETR: both sides; a multiple of 32), pixels; None for what
                ``scaling`` says.
            scaling: how images are prepared; None for the family's usual.

        Raises:
            RaucaError: another kind of model, a number of names that does not fit, a size that it cannot take.
        """
        self._family: Family = family_of(name, getattr(getattr(model, "config", None), "model_type", None))
        self.name, self.class_names = name, class_names or _names_of(model)
        scaling = scaling or self._family.scaling
        self.scaling = scaling if size is None else scaling.of_size(name, size)
        require_names(name, model.config.num_labels, self.class_names)
        self.network = model.eval().requires_grad_(False)
        self.fingerprint = fingerprint(model, self.class_names, self.scaling, _settings(model.config.to_dict()))
        freeze_batch_norms(model)  # RT-DETR flattens what they make: see there

    @property
    def side(self) -> int:
        """The shorter side that images are scaled to, pixels."""
        return self.scaling.shortest or min(self.scaling.height, self.scaling.width)

    def losses(self, images: Tensor, truths: Sequence[Truth]) -> dict[str, Tensor]:
        """transformers' own loss, which matches a query to each object, of a network in training mode; boxes in the
        images' pixels."""
        size = images.new_tensor([images.shape[3], images.shape[2]] * 2)
        labels = [{"class_labels": one.labels, "boxes": centered(one.boxes) / size} for one in truths]
        return {"loss": self.network(pixel_values=self.scaling.fit(self.name, images), labels=labels).loss}

    def _final(self, images: Tensor, score_threshold: float, iou_threshold: float) -> list[Detections]:
        return of_queries(self._predict(images), score_threshold, self._family.softmax, self._family.limit)

    def _predict(self, images: Tensor) -> DensePredictions:
        found = self.network(pixel_values=self.scaling.fit(self.name, images))
        boxes = corners(found.pred_boxes)
        boxes = boxes * boxes.new_tensor([images.shape[3], images.shape[2]] * 2)
        classes = found.logits.softmax(-1)[..., :-1] if self._family.softmax else found.logits.sigmoid()
        return DensePredictions(boxes, torch.ones_like(boxes[..., 0]), classes)


def load(found: Resolved, size: int | None) -> TransformersDetector:
    """Of a folder as ``hf download REPOSITORY --local-dir FOLDER`` makes it; nothing is fetched.

    It holds ``config.json`` (architecture and class names), ``model.safetensors`` and, if the model's images are not
    prepared as its family's usually are, ``preprocessor_config.json``. The published DETR and Deformable DETR are read
    without timm.
    """
    folder = found.files[0]
    model = load_model(folder)
    scaling = read_scaling(folder / "preprocessor_config.json", family_of(found.name, model.config.model_type).scaling)
    return TransformersDetector(found.name, model, size=size, scaling=scaling)


def _settings(value: Any) -> Any:
    """A configuration without what says where it came from."""
    if not isinstance(value, dict):
        return str(value)
    return sorted((str(key), _settings(one)) for key, one in value.items() if key not in _ORIGIN)


def _names_of(model: Any) -> tuple[str, ...]:
    """The configuration's names by index, as COCO writes them."""
    return tuple(canonical(str(model.config.id2label[index])) for index in range(model.config.num_labels))
