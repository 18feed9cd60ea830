"""The detectors of a study: loaded once, checked before anything is rendered, and grouped as the paper's tables are."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence

from ..contract import RaucaError
from ..detect import Detector, class_index, find_class, load_detector
from ..detect.weights import ready_names
from ..runtime.devices import find_device
from .job import Machine

ALL = "all"
LOG = logging.getLogger(__name__)
Chosen = tuple[str, Detector]
"""A detector, and what it was named by."""

SINGLE_STAGE, TWO_STAGE, TRANSFORMER, OTHER = "single-stage", "two-stage", "transformer", "other"
FAMILIES = (SINGLE_STAGE, TWO_STAGE, TRANSFORMER, OTHER)

# The first that matches counts: RT-DETR and YOLOS are transformers, and Faster R-CNN on MobileNet has two stages.
_RULES = (
    (TRANSFORMER, r"detr|ddtr|yolos|vitdet|dino"),
    (TWO_STAGE, r"r-?_?cnn|rcn\b"),
    (SINGLE_STAGE, r"yolo|ssd|retina|fcos|efficientdet|centernet|rtmdet|mobilenet"),
)


def detectors_for(
    given: Sequence[Detector | str], categories: Sequence[str], machine: Machine, published: bool = False
) -> dict[str, list[Chosen]]:
    """The detectors that each category of vehicle is shown to, each loaded once and with what it was named by.

    Args:
        given: loaded ones, or names and files, which must know every category; ``all``, or nothing, for every one that
            is ready, but for those that do not know a category.
        machine: has them at hand from then on.
        published: of the ready ones only those that were not trained on this project's images.

    Raises:
        RaucaError: none is ready, or a detector that was given does not know a category.
    """
    find_device(machine.device)
    named = list(dict.fromkeys(one for one in given if one != ALL))
    ready = [name for name in ready_names() if name not in named] if ALL in given or not given else []
    ready = [name for name in ready if not (published and is_own(name))]
    if not named and not ready:
        raise RaucaError("--detectors: none is ready; get weights with `rauca weights fetch --all`")
    loaded: list[Chosen] = [
        (one, load_detector(one, device=machine.device)) if isinstance(one, str) else (one.name, one.to(machine.device))
        for one in [*named, *ready]
    ]
    machine.loaded.update({detector.fingerprint: detector for _, detector in loaded})
    result = {}
    for category in dict.fromkeys(categories):
        blind = {n for n, d in loaded if n in ready and find_class(d.class_names, category) is None}
        for name in sorted(blind):
            LOG.warning("%s: knows no class %r, left out there", name, category)
        result[category] = [(name, detector) for name, detector in loaded if name not in blind]
        check_detectors([detector for _, detector in result[category]], category)
    return result


def check_detectors(detectors: Sequence[Detector], category: str) -> None:
    """Raise :class:`RaucaError` unless there are detectors, each with a name of its own and the class ``category``."""
    names = [detector.name for detector in detectors]
    if not names:
        raise RaucaError("evaluate: no detectors given; name at least one")
    if len(set(names)) != len(names):
        raise RaucaError(f"evaluate: detectors {', '.join(names)} must have names of their own")
    for detector in detectors:
        class_index(detector, category)


def family_of(detector: str) -> str:
    """One of :data:`FAMILIES`.

    >>> [family_of(name) for name in ("yolov3-tiny", "frcnn-synth", "deformable-detr", "mine")]
    ['single-stage', 'two-stage', 'transformer', 'other']
    """
    name = detector.lower()
    return next((family for family, pattern in _RULES if re.search(pattern, name)), OTHER)


# Detectors whose networks and weights have a common ancestor: paint made against one reaches the others more easily.
_LINEAGES = (
    ("darknet", r"^yolov[234](?!\d)"),
    ("ultralytics", r"^yolov?(5|8|9|1[0-2]|26)[nsmlx]?u?(?![a-z\d])"),
    ("yolox", r"^yolox"),
    ("ssd", r"ssd"),
)


def lineage_of(detector: str) -> str:
    """Whose relative a detector is: darknet's YOLOs, Ultralytics', YOLOX, SSDs; its own name where none is known.

    >>> [lineage_of(name) for name in ("yolov3-tiny", "yolov8n", "yolo11s", "yolox-nano", "mobilenet-ssd", "mine")]
    ['darknet', 'ultralytics', 'ultralytics', 'yolox', 'ssd', 'mine']
    """
    name = detector.lower().removeprefix("hardened-")
    return next((lineage for lineage, pattern in _LINEAGES if re.search(pattern, name)), name)


def is_own(detector: str) -> bool:
    """Whether it is one of this project's detectors, trained on synthetic images; they are named so."""
    return detector.endswith("-synth")


def in_table_order(detectors: list[str]) -> list[str]:
    """By family; within a family our own come last, the rest stay in the order given."""
    return sorted(detectors, key=lambda name: (FAMILIES.index(family_of(name)), is_own(name)))
