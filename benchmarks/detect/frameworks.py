"""Detectors of torchvision and transformers with seeded random weights, beside the frameworks' own post-processing."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor

from rauca_core.detect.frameworks import (
    TorchvisionDetector,
    TransformersDetector,
    import_torchvision,
    import_transformers,
)

from .contender import Contender, Rows

NAMES = ("car", "boat", "bus")
SIZE = 320
THRESHOLDS = (0.2, 0.5)
RANDOM = "random weights"


@contextmanager
def torchvision(architecture: str) -> Iterator[Contender]:
    """Faster R-CNN or SSDlite: softmax over few categories, so random weights make detections too."""
    version = import_torchvision().__version__
    detector = TorchvisionDetector(architecture, architecture, None, NAMES, None if "ssd" in architecture else SIZE)
    reference: Any = copy.deepcopy(detector.model)
    limits = getattr(reference, "roi_heads", reference)
    limits.score_thresh, limits.nms_thresh = THRESHOLDS
    yield Contender(
        f"{architecture} ({RANDOM})",
        f"torchvision {version}",
        SIZE,
        detector,
        prepare=list,
        run=torch.inference_mode()(reference),
        rows=lambda found: _rows(found, first_label=1),  # 0 is the background
        final=True,
        thresholds=THRESHOLDS,
    )


@contextmanager
def transformers(prefix: str) -> Iterator[Contender]:
    """DETR, Deformable DETR or RT-DETR of its usual size."""
    package = import_transformers()
    torch.manual_seed(0)
    labels: dict[str, Any] = {"id2label": dict(enumerate(NAMES))}
    if prefix != "RTDetr":
        labels |= {"backbone_config": package.ResNetConfig(out_features=["stage4"]), "use_timm_backbone": False}
    if prefix == "DeformableDetr":
        labels["backbone_config"] = package.ResNetConfig(out_features=["stage2", "stage3", "stage4"])
    model = getattr(package, f"{prefix}ForObjectDetection")(getattr(package, f"{prefix}Config")(**labels)).eval()
    size = {"height": SIZE, "width": SIZE} if prefix == "RTDetr" else {"shortest_edge": SIZE, "longest_edge": SIZE}
    processor = getattr(package, f"{prefix}ImageProcessor")(size=size)
    detector = TransformersDetector.of(model, prefix, size=SIZE)
    threshold = _low_score(detector)

    @torch.inference_mode()
    def run(images: list[Tensor]) -> Any:
        prepared = processor(images=images, do_rescale=False, return_tensors="pt")
        outputs = model(**prepared)
        sizes = [(SIZE, SIZE)] * len(images)
        return processor.post_process_object_detection(outputs, threshold=threshold, target_sizes=sizes)

    yield Contender(
        f"{prefix} ({RANDOM})",
        f"transformers {package.__version__}",
        SIZE,
        detector,
        prepare=list,
        run=run,
        rows=lambda found: _rows(found, first_label=0),
        final=True,
        thresholds=(threshold, 1.0),
    )


def _low_score(detector: TransformersDetector) -> float:
    """Nearly every query is a detection, whatever random weights make of the scores of other pictures."""
    with torch.no_grad():
        return float(detector.dense(torch.full((1, 3, SIZE, SIZE), 0.5)).classes.amax(2).median() / 2)


def _rows(found: list[dict[str, Tensor]], first_label: int) -> Rows:
    (one,) = found
    boxes, labels = one["boxes"].clamp(0, SIZE) / SIZE, one["labels"] - first_label
    return torch.cat([boxes, one["scores"][:, None], labels[:, None]], 1).numpy()
