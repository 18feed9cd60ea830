"""Names of categories, which darknet's, VOC's and COCO's lists write differently."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from ..contract import RaucaError
from ..contract.assets import assets_folder
from ..contract.reading import read_text
from .interface import Detector

MAX_NAMES_BYTES = 2**20  # the longest list in use, LVIS, has 1203 names

# COCO numbers its 80 categories up to 90; the numbers in between belong to none.
GAP = "n/a"

OWN_CLASSES = ("car", "boat", "bus", "truck")
"""Of the detectors that come with rauca."""

# From the names of darknet's and VOC's lists to COCO's, which data sets use.
_COCO_NAMES = {
    "aeroplane": "airplane",
    "motorbike": "motorcycle",
    "diningtable": "dining table",
    "sofa": "couch",
    "pottedplant": "potted plant",
    "tvmonitor": "tv",
    "tv monitor": "tv",
}


def canonical(name: str) -> str:
    """COCO's name of a category, in lower case; a name that COCO does not know is its own."""
    plain = " ".join(name.lower().replace("_", " ").split())
    return _COCO_NAMES.get(plain, plain)


def class_list(name: str) -> tuple[str, ...]:
    """The shipped list ``coco-80``, ``coco-91`` or ``voc-20``, in canonical names.

    ``coco-91`` has 90 entries: category 1 comes first, and :data:`GAP` stands where COCO left a number out.
    """
    return tuple(canonical(line) for line in read_names(assets_folder() / "detectors" / f"{name}.names"))


def unusual_names(class_names: Sequence[str]) -> str:
    """What a detector's fingerprint says of its class names: nothing of the usual lists, all of any other."""
    names = tuple(map(canonical, class_names))
    return "" if names in (class_list("coco-80"), OWN_CLASSES) else json.dumps(names)


def find_class(class_names: Sequence[str], category: str) -> int | None:
    """Index of ``category`` under any of its names; None when the list lacks it."""
    wanted = canonical(category)
    if wanted == GAP:
        return None
    return next((index for index, name in enumerate(class_names) if canonical(name) == wanted), None)


def require_names(where: object, classes: int, names: Sequence[str]) -> None:
    """Refuse another number of names than the network of ``where``, a file or a detector's name, has classes."""
    if len(names) != classes:
        raise RaucaError(f"{where}: the network predicts {classes} classes, {len(names)} names were given")


def read_names(path: Path) -> tuple[str, ...]:
    """Class names, one per line.

    Raises:
        RaucaError: missing, unreadable or empty file.
    """
    lines = read_text(path, MAX_NAMES_BYTES, "a list of class names").splitlines()
    names = tuple(line.strip() for line in lines if line.strip())
    if not names:
        raise RaucaError(f"{path}: holds no class names")
    return names


def class_index(detector: Detector, category: str) -> int:
    """Index of ``category``, under whichever name the detector's list uses for it.

    Raises:
        RaucaError: the detector has no such class.
    """
    index = find_class(detector.class_names, category)
    if index is None:
        raise RaucaError(
            f"{detector.name}: knows no class {category!r} (its {len(detector.class_names)} are "
            f"{', '.join(detector.class_names[:4])} ...); choose a detector trained on it, or another class"
        )
    return index
