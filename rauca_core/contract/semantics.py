"""What a pixel shows: semantic classes, and which vehicle.

``semantic.png`` holds a class id per pixel and ``instances.png`` a vehicle's number. Both are plain grey 8-bit PNGs:
Pillow, OpenCV and every training framework then read the ids themselves, whereas OpenCV silently turns a palette PNG
into its colors. ``rauca dataset view`` paints them in :data:`PALETTE`.

In Blender a material names its class in the custom property ``rauca_class``, and an object that is another vehicle
carries ``rauca_instance`` and ``rauca_category``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CLASSES = (
    "unlabeled",
    "sky",
    "road",
    "marking",
    "kerb",
    "pavement",
    "terrain",
    "building",
    "window",
    "vegetation",
    "pole",
    "paint",
    "glass",
    "tyre",
    "vehicle_part",
    "other_vehicle",
    "other",
)
"""Names by id; ids are part of the format and never change meaning."""

CLASS_IDS = {name: number for number, name in enumerate(CLASSES)}
VEHICLE_CLASSES = ("paint", "glass", "tyre", "vehicle_part")
"""What the data set's vehicle is made of; everything else that drives is ``other_vehicle``."""

CLASS_PROPERTY = "rauca_class"
INSTANCE_PROPERTY = "rauca_instance"
CATEGORY_PROPERTY = "rauca_category"

NO_INSTANCE = 0
TARGET_INSTANCE = 255
"""The data set's own vehicle in ``instances.png``; others are 1 to 254."""

PALETTE: NDArray[np.uint8] = np.array(
    [
        (0, 0, 0),
        (112, 170, 214),
        (98, 92, 104),
        (236, 232, 220),
        (164, 158, 150),
        (196, 160, 176),
        (148, 176, 112),
        (128, 116, 104),
        (78, 108, 136),
        (70, 122, 62),
        (190, 170, 90),
        (226, 74, 51),
        (60, 196, 206),
        (44, 40, 60),
        (244, 160, 60),
        (120, 84, 190),
        (150, 150, 150),
    ],
    dtype=np.uint8,
)
"""(classes, 3) sRGB colors for people; Cityscapes' hues where a class exists there, the vehicle's parts loud."""
