"""MMDetection's detectors behind the common interface, where MMDetection 3 is installed."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from ...contract import RaucaError
from ..classes import class_list
from ..families import MMDET_INSTALL, Resolved
from ..interface import DensePredictions, Detections
from ..nms import SinglePassDetector, clipped
from .checkpoint import fill, fingerprint, read_state
from .mmdet_config import read_config
from .torchvision_ops import import_torchvision

# Candidates of an image that dense looks at: the best so many of those more probable than this.
_CANDIDATES = 1000
_LEAST_SCORE = 1e-3


class MmdetDetector(SinglePassDetector):
    """A detector of MMDetection 3 (Dynamic R-CNN, Sparse R-CNN and the rest).

    Everything is MMDetection's own ``predict``, which lets gradients through. ``dense`` runs it with nothing
    suppressed: up to 1000 pairs of box and category with a score above 0.001, each with its category's score alone;
    ``objectness`` is 1, or 0 where an image has fewer. ``detect`` runs it with the caller's thresholds; detectors
    without suppression (Sparse R-CNN, the DETRs) leave ``iou_threshold`` unused.

    MMDetection is no dependency of this project and its compiled operators are not part of the package index, so the
    project's tests predict with it only where it happens to be installed. The adapter was checked by hand against
    MMDetection 3.3 with random weights of Dynamic R-CNN, Sparse R-CNN and RetinaNet, with this project's operators in
    place of MMCV's compiled ones.

    Attributes:
        name, class_names, fingerprint: see :class:`rauca_core.detect.Detector`.
        network: MMDetection's module, in evaluation mode; its weights take no gradient.
    """

    def __init__(self, name: str, config: Path, checkpoint: Path, class_names: tuple[str, ...] | None = None) -> None:
        """Build the network of ``config`` and read ``checkpoint``.

        Args:
            config: the JSON dump of a configuration; one in Python is refused, as it would be run. See
                :data:`rauca_core.detect.frameworks.mmdet_config.DUMP` for how to make it.
            checkpoint: ``.pth`` that holds tensors and plain values only, or ``.safetensors``.
            class_names: None for COCO's 80.

        Raises:
            RaucaError: MMDetection is missing, a configuration or checkpoint that is unreadable or does not fit.
        """
        described, self._preparation = read_config(config)
        registry = import_registry()
        try:
            model = registry.build(importlib.import_module("mmengine.config").ConfigDict(described))
        except Exception as error:  # whatever a module's constructor makes of wrong options
            reason = " ".join(str(error).split())[:200]
            raise RaucaError(f"{config}: MMDetection cannot build this model ({reason})") from error
        fill(model, read_state(checkpoint), checkpoint)
        self.name = name
        self.class_names = class_list("coco-80") if class_names is None else class_names
        classes = _classes_of(model)
        if classes != len(self.class_names):
            raise RaucaError(
                f"{name}: the model predicts {classes} categories, {len(self.class_names)} names were given"
            )
        self.network: Any = model.eval().requires_grad_(False)
        digest = hashlib.sha256(config.read_bytes()).hexdigest()
        self.fingerprint = fingerprint(model, self.class_names, self._preparation, digest)

    def _predict(self, images: Tensor) -> DensePredictions:
        most = min(_CANDIDATES, _pairs_of(self.network) or _CANDIDATES)
        with _undetached(self.network):
            found = self._found(images, _LEAST_SCORE, 1.0, most)  # no overlap exceeds 1
        if torch.is_grad_enabled() and images.requires_grad and not found[0].scores.requires_grad:
            raise RaucaError(f"{self.name}: this head of MMDetection gives no gradients; use it for detection only")
        classes = [
            one.scores[:, None] * torch.nn.functional.one_hot(one.labels, len(self.class_names)) for one in found
        ]
        boxes = [one.boxes for one in found]
        ones = [torch.ones_like(one.scores) for one in found]
        padded = [pad_sequence(one, batch_first=True) for one in (boxes, ones, classes)]
        return DensePredictions(padded[0], padded[1], padded[2])

    @torch.no_grad()
    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        """Final detections per image, boxes clipped to it; see :class:`rauca_core.detect.Detector`."""
        images = self._checked(images, waits=True)
        return clipped(self._found(images, score_threshold, iou_threshold), images)

    def _found(
        self, images: Tensor, score_threshold: float, iou_threshold: float, most: int | None = None
    ) -> list[Detections]:
        batch, size = self._preparation.fit(self.name, images)
        samples = [_sample(size, tuple(batch.shape[2:])) for _ in images]
        with _limits(self.network, score_threshold, iou_threshold, most):
            predicted = self.network.predict(batch, samples, rescale=False)
        scale = batch.new_tensor([images.shape[3] / size[1], images.shape[2] / size[0]] * 2)
        return [_sorted(sample.pred_instances, scale, score_threshold) for sample in predicted]


def load(found: Resolved, size: int | None) -> MmdetDetector:
    """Of a folder with a dumped configuration and a checkpoint; the size is the configuration's."""
    files = []
    for pattern in ("*.json", "*.pth"):
        held = sorted(found.files[0].glob(pattern))
        if len(held) != 1:
            raise RaucaError(f"{found.files[0]}: must hold exactly one {pattern}, found {len(held)}")
        files += held
    return MmdetDetector(found.name, *files, class_names=found.class_names)


def import_registry() -> Any:
    """MMDetection's registry of models; raises :class:`RaucaError` where it is not installed, or too old or new."""
    import_torchvision()
    try:
        importlib.import_module("mmdet.utils").register_all_modules()
        return importlib.import_module("mmdet.registry").MODELS
    except (ImportError, AssertionError) as error:  # mmdet asserts the version of mmcv
        reason = " ".join(str(error).split())[:120]
        raise RaucaError(f"MMDetection 3 cannot be imported ({reason}); install it with: {MMDET_INSTALL}") from error


def _sample(size: tuple[int, int], padded: tuple[int, ...]) -> Any:
    sample = importlib.import_module("mmdet.structures").DetDataSample()
    sample.set_metainfo(
        {
            "img_shape": size,
            "ori_shape": size,
            "pad_shape": padded,
            "batch_input_shape": padded,
            "scale_factor": (1.0, 1.0),
        }
    )
    return sample


def _sorted(instances: Any, scale: Tensor, score_threshold: float) -> Detections:
    order = instances.scores.argsort(descending=True, stable=True)
    order = order[instances.scores[order] > score_threshold]
    return Detections(instances.bboxes[order] * scale, instances.scores[order], instances.labels[order])


def _last_head(model: Any) -> Any:
    """The module that makes the final predictions; it holds their limits in ``test_cfg``."""
    return model.roi_head if hasattr(model, "roi_head") else model.bbox_head


def _classes_of(model: Any) -> int:
    head = model.roi_head.bbox_head if hasattr(model, "roi_head") else model.bbox_head
    return int((head[-1] if hasattr(head, "__getitem__") else head).num_classes)


def _pairs_of(model: Any) -> int:
    """Pairs of query and category in detectors with a fixed number of queries, which cannot give more; else 0."""
    queries = getattr(model, "num_queries", 0) or getattr(getattr(model, "rpn_head", None), "num_proposals", 0)
    return int(queries) * _classes_of(model)


@contextlib.contextmanager
def _undetached(model: Any) -> Iterator[None]:
    """One-stage heads take an image's predictions out of the batch with a function that detaches them by default."""
    name = "select_single_mlvl"
    kinds = () if hasattr(model, "roi_head") else type(model.bbox_head).__mro__
    modules = {sys.modules[kind.__module__] for kind in kinds if hasattr(sys.modules[kind.__module__], name)}
    originals = {module: getattr(module, name) for module in modules}

    def attached(tensors: list[Tensor], index: int, detach: bool = False) -> list[Tensor]:
        return [one[index] for one in tensors]

    try:
        for module in modules:
            setattr(module, name, attached)
        yield
    finally:
        for module, original in originals.items():
            setattr(module, name, original)


@contextlib.contextmanager
def _limits(model: Any, score: float, iou: float, most: int | None) -> Iterator[None]:
    """The caller's limits for one call; those that a detector does not have stay away."""
    holder = _last_head(model)
    before = holder.test_cfg
    limits = dict(before)
    if "score_thr" in limits:
        limits["score_thr"] = score
    if "nms" in limits:
        limits["nms"] = dict(limits["nms"], iou_threshold=iou)
    if most is not None:
        limits["max_per_img"] = most
    holder.test_cfg = type(before)(limits)
    try:
        yield
    finally:
        holder.test_cfg = before
