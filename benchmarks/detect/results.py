"""Everything one run found, its JSON, and what was hoped for."""

from __future__ import annotations

import math
import platform
from dataclasses import asdict, dataclass
from typing import Any

LARGEST_DIFFERENCE = 1e-3
LARGEST_RATIO = 1.5


@dataclass(frozen=True)
class Adapter:
    """One adapter beside its reference; times are medians per image in CPU milliseconds on one core.

    Attributes:
        max_abs_difference: of any score, or box side as a fraction of the image's, over all images.
        forward_ms: predictions without gradients, or detections where those are compared.
        backward_ms: an attack's step: predictions with gradients and their way back to the image.
        forward_ratio: median over images of ours by theirs.
        compared: ``predictions`` before suppression, or ``detections`` after.
        images: on which the difference was taken.
    """

    name: str
    max_abs_difference: float
    forward_ms: float
    backward_ms: float
    reference: str
    reference_forward_ms: float
    forward_ratio: float
    compared: str
    images: int

    @property
    def agrees(self) -> bool:
        return self.max_abs_difference <= LARGEST_DIFFERENCE

    @property
    def fast_enough(self) -> bool:
        return self.forward_ratio <= LARGEST_RATIO


@dataclass(frozen=True)
class Results:
    """One run.

    Attributes:
        images, source: how many and where they come from.
        missing: adapter and why it was not measured.
    """

    images: int
    source: str
    adapters: tuple[Adapter, ...]
    missing: tuple[tuple[str, str], ...]

    def to_json(self) -> dict[str, Any]:
        """An infinite difference (another number of predictions) is written as null: JSON has no infinity."""
        rows = [asdict(adapter) for adapter in self.adapters]
        for row in rows:
            if not math.isfinite(row["max_abs_difference"]):
                row["max_abs_difference"] = None
        return {
            "format": "rauca-bench-detect",
            "version": 1,
            "machine": {"processor": platform.machine(), "cores_used": 1},
            "images": self.images,
            "image_source": self.source,
            "milliseconds_are": "median CPU time per image on one core",
            "targets": {"max_abs_difference": LARGEST_DIFFERENCE, "forward_ratio": LARGEST_RATIO},
            "adapters": rows,
            "missing": dict(self.missing),
        }
