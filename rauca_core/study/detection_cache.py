"""Detections that were made before: one line per image, in one file per detector and setting.

A line is keyed by the image's sha256, so a render that changes is detected anew and one that does not never is. That
holds behind a defence too: what is detected in, and hashed, is the defended image.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..contract.files import append_line, write_bytes
from ..contract.schema import Fields, Record, whole_lines
from ..detect import Detections, Detector, canonical
from ..detect.classes import class_index
from ..detect.found import Found

MAX_CACHE_BYTES = 2**30
"""A line is some 5 kB: the detections of 200 000 images."""


@dataclass(frozen=True)
class DetectionSettings(Record):
    """Which detections are kept.

    Attributes:
        category: the target's class.
        score_threshold: lowest score kept for that class; low, because AP integrates over all scores.
        other_threshold: lowest score kept for other classes, which only appear in pictures.
        iou_threshold: of non-maximum suppression.
    """

    category: str = "car"
    score_threshold: float = 0.005
    other_threshold: float = 0.1
    iou_threshold: float = 0.45


class DetectionCache:
    """The detections of one detector under one setting, on disk."""

    def __init__(self, folder: Path, detector_name: str, fingerprint: str, settings: DetectionSettings) -> None:
        """Open or start the file in ``folder``; lines that a killed run or a failing disk left unreadable are dropped,
        and their images detected in again.
        """
        key = hashlib.sha256(f"{fingerprint} {sorted(settings.__dict__.items())}".encode()).hexdigest()[:12]
        self.path = Path(folder) / f"{detector_name}-{key}.jsonl"
        self.settings, self.fingerprint = settings, fingerprint
        self._found: dict[str, Found] = {}
        if self.path.is_file():
            self._found |= whole_lines(self.path, MAX_CACHE_BYTES, "a cache of detections", _found, mend=True)

    def __contains__(self, image_sha256: str) -> bool:
        return image_sha256 in self._found

    def __getitem__(self, image_sha256: str) -> Found:
        return self._found[image_sha256]

    def add(self, detector: Detector, hashes: Sequence[str], found: Sequence[Detections]) -> None:
        """Keep what the settings ask for of a batch of images, in memory and on disk."""
        lines = [self._line(detector, image, one) for image, one in zip(hashes, found, strict=True)]
        if not self.path.exists():
            write_bytes(self.path, b"")
        append_line(self.path, "\n".join(json.dumps(line, allow_nan=False) for line in lines))
        self._found |= dict(_found(Fields(line, self.path.name)) for line in lines)

    def _line(self, detector: Detector, image_sha256: str, detections: Detections) -> dict[str, Any]:
        target = class_index(detector, self.settings.category)
        keep = (detections.labels == target) | (detections.scores >= self.settings.other_threshold)
        return {
            "image": image_sha256,
            "boxes": [[round(x, 2) for x in box] for box in detections.boxes[keep].double().tolist()],
            "scores": [round(score, 7) for score in detections.scores[keep].double().tolist()],
            "names": [canonical(detector.class_names[label]) for label in detections.labels[keep].tolist()],
        }


def _found(line: Fields) -> tuple[str, Found]:
    """An image's sha256, and what was found in it."""
    names = tuple(str(name) for name in line.items("names"))
    boxes = line.array("boxes", (len(names), 4)) if names else np.zeros((0, 4))
    return line.text("image"), Found(boxes, line.array("scores", (len(names),)), names)
