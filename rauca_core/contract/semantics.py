"""What a pixel shows: semantic classes, and which vehicle; the tight boxes of masks.

``semantic.png`` holds a class id per pixel and ``instances.png`` a vehicle's number. Both are plain grey 8-bit PNGs:
Pillow, OpenCV and every training framework then read the ids themselves, whereas OpenCV silently turns a palette PNG
into its colors. ``rauca dataset view`` paints them in :data:`PALETTE`.

In Blender a material names its class in the custom property ``rauca_class``, and an object that is another vehicle
carries ``rauca_instance`` and ``rauca_category``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from .schema import Record

_COLORS = {
    "unlabeled": (0, 0, 0),
    "sky": (112, 170, 214),
    "road": (98, 92, 104),
    "marking": (236, 232, 220),
    "kerb": (164, 158, 150),
    "pavement": (196, 160, 176),
    "terrain": (148, 176, 112),
    "building": (128, 116, 104),
    "window": (78, 108, 136),
    "vegetation": (70, 122, 62),
    "pole": (190, 170, 90),
    "paint": (226, 74, 51),
    "glass": (60, 196, 206),
    "tyre": (44, 40, 60),
    "vehicle_part": (244, 160, 60),
    "other_vehicle": (120, 84, 190),
    "other": (150, 150, 150),
}
CLASSES = tuple(_COLORS)
"""Names by id; ids are part of the format and never change meaning."""
PALETTE: NDArray[np.uint8] = np.array(list(_COLORS.values()), np.uint8)
"""(classes, 3) sRGB colors for people; Cityscapes' hues where a class exists there, the vehicle's parts loud."""

CLASS_IDS = {name: number for number, name in enumerate(CLASSES)}
VEHICLE_CLASSES = ("paint", "glass", "tyre", "vehicle_part")
"""What the data set's vehicle is made of; everything else that drives is ``other_vehicle``."""

CLASS_PROPERTY = "rauca_class"
INSTANCE_PROPERTY = "rauca_instance"
CATEGORY_PROPERTY = "rauca_category"

NO_INSTANCE = 0
TARGET_INSTANCE = 255
"""The data set's own vehicle in ``instances.png``; others are 1 to 254."""

Box = tuple[float, float, float, float]
MIN_BOX_PIXELS = 16
"""Fewer visible pixels than this make no ground truth: nothing could be detected there."""


@dataclass(frozen=True)
class Instance(Record):
    """Another vehicle in view.

    Attributes:
        id: its value in ``instances.png``, 1 to 254.
        category: a COCO class, never that of the data set's vehicle: an image has one object of that.
        box_xyxy: tight box of its visible pixels, pixels; the right and lower edges lie past the last one.
        pixels: how many are visible.
    """

    id: Annotated[int, (NO_INSTANCE + 1, TARGET_INSTANCE - 1)]
    category: str
    box_xyxy: Box
    pixels: Annotated[int, (1, 2**63)]


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
    for number in np.flatnonzero(np.bincount(instances.ravel(), minlength=1)).tolist():
        if number in (NO_INSTANCE, TARGET_INSTANCE):
            continue
        mask = instances == number
        box = mask_box(mask, 1)
        assert box is not None
        found.append(Instance(number, categories[number], box, int(mask.sum())))
    return tuple(found)
