"""Which family a detector belongs to, told from its name, as the paper's tables group them."""

from __future__ import annotations

import re

SINGLE_STAGE, TWO_STAGE, TRANSFORMER, OTHER = "single-stage", "two-stage", "transformer", "other"
FAMILIES = (SINGLE_STAGE, TWO_STAGE, TRANSFORMER, OTHER)

# The first that matches counts: RT-DETR and YOLOS are transformers, and Faster R-CNN on MobileNet has two stages.
_RULES = (
    (TRANSFORMER, r"detr|ddtr|yolos|vitdet|dino"),
    (TWO_STAGE, r"r-?_?cnn|rcn\b"),
    (SINGLE_STAGE, r"yolo|ssd|retina|fcos|efficientdet|centernet|rtmdet|mobilenet"),
)


def family_of(detector: str) -> str:
    """One of :data:`FAMILIES`.

    >>> [family_of(name) for name in ("yolov3-tiny", "frcnn-synth", "deformable-detr", "mine")]
    ['single-stage', 'two-stage', 'transformer', 'other']
    """
    name = detector.lower()
    return next((family for family, pattern in _RULES if re.search(pattern, name)), OTHER)


def is_own(detector: str) -> bool:
    """Whether it is one of this project's detectors, trained on synthetic images; they are named so."""
    return detector.endswith("-synth")


def in_table_order(detectors: list[str]) -> list[str]:
    """By family; within a family our own come last, the rest stay in the order given."""
    return sorted(detectors, key=lambda name: (FAMILIES.index(family_of(name)), is_own(name)))
