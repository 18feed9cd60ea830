"""Which of a head's score columns a list of class names means. Column 0 is the background in all these networks."""

from __future__ import annotations

from pathlib import Path

from ...contract import RaucaError

# COCO numbers its 80 categories from 1 to 90; these ids were never given out, but heads have columns for them.
COCO_GAPS = frozenset({12, 26, 29, 30, 45, 66, 68, 69, 71, 83})
COCO_IDS = tuple(label for label in range(1, 91) if label not in COCO_GAPS)


def score_columns(path: Path, columns: int, class_names: tuple[str, ...]) -> tuple[int, ...]:
    """The column of each class name.

    Args:
        path: the network's file, for the error.
        columns: of the head, the background among them.
        class_names: one per column after the background; or the 80 names of COCO in their order for a head of 91.

    Raises:
        RaucaError: another number of names.
    """
    if len(class_names) == columns - 1:
        return tuple(range(1, columns))
    if len(class_names) == len(COCO_IDS) and columns == 91:
        return COCO_IDS
    also = f", or the {len(COCO_IDS)} of COCO" if columns == 91 else ""
    raise RaucaError(
        f"{path}: the network predicts {columns - 1} classes{also}; {len(class_names)} class names were given"
    )
