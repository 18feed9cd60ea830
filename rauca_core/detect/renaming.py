"""A detector with class names of its own, read in the names that data sets use."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any, Self

import torch
from torch import Tensor

from ..contract import RaucaError
from ..runtime.devices import threads
from .classes import canonical
from .interface import OVERLAP, DensePredictions, Detections, Detector
from .nms import suppress

MOST_TOLD = 40  # names in an error's line; LVIS has 1203


def parse_classes(text: str) -> dict[str, str]:
    """``"vehicle.car=car,vehicle.taxi=car"`` as the mapping that :func:`rauca_core.detect.load_detector` takes.

    Raises:
        RaucaError: a part that is no ``OWN=NAME``, or an own name that stands twice.
    """
    found: dict[str, str] = {}
    for part in text.split(","):
        own, _, name = (side.strip() for side in part.rpartition("="))
        if not own or not name:
            raise RaucaError(
                f"--classes: {part.strip()!r} is no OWN=NAME; write it like vehicle.car=car,vehicle.van=truck"
            )
        if own in found:
            raise RaucaError(f"--classes: {own!r} stands twice; give each of the detector's names once")
        found[own] = name
    return found


def renamed(detector: Detector, classes: Mapping[str, str] | None) -> Detector:
    """The detector, its class ``own`` called ``classes[own]``; the detector itself where nothing is renamed.

    Raises:
        RaucaError: the detector has no class of such an own name.
    """
    return RenamedDetector(detector, classes) if classes else detector


class RenamedDetector:
    """Another detector whose classes have other names; several of its classes may become one.

    ``dense`` gives a merged class the largest of its classes' probabilities. ``detect`` suppresses a merged class once
    more, as an object that was found as a car and as a taxi is one car. Classes that are not in the mapping keep their
    names; one that is already called as another is to be called is merged with it.

    Attributes:
        detector: the one that predicts.
    """

    def __init__(self, detector: Detector, classes: Mapping[str, str]) -> None:
        """Errors as of :func:`renamed`."""
        own = [canonical(name) for name in detector.class_names]
        wanted = {canonical(name): canonical(new) for name, new in classes.items()}
        for name in classes:
            if canonical(name) not in own:
                raise RaucaError(f"{detector.name}: has no class {name!r} to rename; its own are {_told(detector)}")
        targets = set(wanted.values())
        groups: dict[str | int, list[int]] = {}  # of columns; names that nobody asked for may stand twice, as gaps do
        for index, name in enumerate(own):
            new = wanted.get(name, name)
            groups.setdefault(new if new in targets else index, []).append(index)
        ordered = sorted(groups.values(), key=lambda group: len(group) > 1)  # merged ones last
        self._alone = [group[0] for group in ordered if len(group) == 1]
        self._merged = ordered[len(self._alone) :]
        self.class_names = tuple(wanted.get(own[group[0]], detector.class_names[group[0]]) for group in ordered)
        places = {index: place for place, group in enumerate(ordered) for index in group}
        self._places = torch.tensor([places[index] for index in range(len(own))])
        self.detector, self.name = detector, detector.name
        settings = json.dumps([detector.fingerprint, self.class_names, self._places.tolist()])
        self.fingerprint = hashlib.sha256(settings.encode()).hexdigest()

    def __getattr__(self, name: str) -> Any:
        """What else the detector has, such as the ``network`` that some losses look into."""
        if name == "detector":  # not there yet
            raise AttributeError(name)
        return getattr(self.detector, name)

    def to(self, device: torch.device | str) -> Self:
        """Move the network to a device; returns self."""
        self.detector = self.detector.to(device)
        return self

    def dense(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1]; gradients flow to ``images``."""
        found = self.detector.dense(images)
        merged = [found.classes[..., group].amax(-1, keepdim=True) for group in self._merged]
        return DensePredictions(
            found.boxes, found.objectness, torch.cat([found.classes[..., self._alone], *merged], -1)
        )

    @torch.no_grad()
    def detect(
        self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = OVERLAP
    ) -> list[Detections]:
        """Final detections per image; see :class:`rauca_core.detect.Detector`."""
        found = self.detector.detect(images, score_threshold, iou_threshold)
        with threads(1):
            return [self._named(one, iou_threshold) for one in found]

    def _named(self, found: Detections, iou_threshold: float) -> Detections:
        labels = self._places.to(found.labels.device)[found.labels]
        kept = torch.ones_like(labels, dtype=torch.bool)
        for place in range(len(self._alone), len(self.class_names)):
            mine = (labels == place).nonzero()[:, 0]
            kept[mine] = suppress(found.boxes[mine], iou_threshold)
        return Detections(found.boxes[kept], found.scores[kept], labels[kept])


def _told(detector: Detector) -> str:
    names = detector.class_names
    more = f" and {len(names) - MOST_TOLD} more" if len(names) > MOST_TOLD else ""
    return ", ".join(names[:MOST_TOLD]) + more
