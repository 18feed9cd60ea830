"""Other vehicles in a frame, and the tight boxes of masks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .schema import Fields
from .semantics import NO_INSTANCE, TARGET_INSTANCE

Box = tuple[float, float, float, float]
MIN_BOX_PIXELS = 16
"""Fewer visible pixels than this make no ground truth: nothing could be detected there."""


@dataclass(frozen=True)
class Instance:
    """Another vehicle in view.

    Attributes:
        id: its value in ``instances.png``, 1 to 254.
        category: a COCO class, never that of the data set's vehicle: an image has one object of that.
        box_xyxy: tight box of its visible pixels, pixels; the right and lower edges lie past the last one.
        pixels: how many are visible.
    """

    id: int
    category: str
    box_xyxy: Box
    pixels: int

    def to_json(self) -> dict[str, Any]:
        return {"id": self.id, "category": self.category, "box_xyxy": list(self.box_xyxy), "pixels": self.pixels}

    @staticmethod
    def from_json(fields: Fields) -> Instance:
        left, top, right, bottom = fields.array("box_xyxy", (4,)).tolist()
        instance = Instance(
            fields.integer("id", NO_INSTANCE + 1, TARGET_INSTANCE - 1),
            fields.text("category"),
            (left, top, right, bottom),
            fields.integer("pixels", 1),
        )
        fields.done()
        return instance


def mask_box(mask: NDArray[np.bool_], fewest: int = MIN_BOX_PIXELS) -> Box | None:
    """Tight box of an (H, W) mask, pixels: left, top, right, bottom; None when fewer than ``fewest`` are set."""
    rows, columns = np.nonzero(mask)
    if rows.size < fewest:
        return None
    return float(columns.min()), float(rows.min()), float(columns.max() + 1), float(rows.max() + 1)


def find_instances(instances: NDArray[np.uint8], categories: dict[int, str]) -> tuple[Instance, ...]:
    """The other vehicles of an (H, W) map of instance ids, by id.

    Args:
        categories: COCO class of every id that may occur.
    """
    found = []
    for number in np.unique(instances).tolist():
        if number in (NO_INSTANCE, TARGET_INSTANCE):
            continue
        mask = instances == number
        box = mask_box(mask, 1)
        assert box is not None
        found.append(Instance(number, categories[number], box, int(mask.sum())))
    return tuple(found)
