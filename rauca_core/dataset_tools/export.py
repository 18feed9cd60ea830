"""``rauca dataset export``: COCO JSON or YOLO labels beside the images, for any trainer or evaluation tool.

::

    coco   OUT/annotations.json, OUT/images/<frame>.png
    yolo   OUT/data.yaml, OUT/images/<frame>.png, OUT/labels/<frame>.txt
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Progress, RaucaError
from ..contract.files import disk_errors, write_bytes, write_json
from .stored_frame import StoredFrame, Target, categories_of, coco_id, target_category, targets_of

FORMATS = ("coco", "yolo")
Moved = Callable[[Progress], None]


def export_dataset(folder: Path, form: str, out: Path, progress: Moved = lambda _: None) -> int:
    """Write a data set's frames and ground truth in another layout, with copies of the images.

    Args:
        form: ``coco`` or ``yolo``.
        out: a new folder, or one that an earlier export of the same data set filled.

    Returns:
        how many targets were written.

    Raises:
        RaucaError: unknown format, nothing to export, a damaged frame, or a full disk.
    """
    if form not in FORMATS:
        raise RaucaError(f"format {form!r} is unknown; choose one of {', '.join(FORMATS)}")
    dataset = Dataset(folder)
    frames = StoredFrame.all_of(dataset)
    if not frames:
        raise RaucaError(f"{folder}: no finished frame to export; make the data set first")
    own = target_category(dataset)
    categories = categories_of(frames, own)
    write = _Coco(out, dataset, categories) if form == "coco" else _Yolo(out, dataset, categories)
    written = 0
    for done, stored in enumerate(frames, 1):
        _copy(stored.folder / "image.png", out / "images" / f"{stored.frame.id}.png")
        targets = list(targets_of(stored, own))
        write.frame(stored, targets)
        written += len(targets)
        progress(Progress(done, len(frames), stored.frame.id))
    write.finish()
    return written


class _Coco:
    """COCO detection JSON; masks are exact run lengths, holes and occlusion included."""

    def __init__(self, out: Path, dataset: Dataset, categories: list[str]) -> None:
        self._out, self._dataset, self._categories = out, dataset, categories
        self._images: list[dict[str, Any]] = []
        self._annotations: list[dict[str, Any]] = []

    def frame(self, stored: StoredFrame, targets: list[Target]) -> None:
        frame, number = stored.frame, len(self._images) + 1
        self._images.append(
            {
                "id": number,
                "file_name": f"images/{frame.id}.png",
                "width": frame.camera.width,
                "height": frame.camera.height,
                "weather": frame.weather.name,
                "location": frame.location,
                "view": frame.view,
            }
        )
        for target in targets:
            left, top, right, bottom = target.box_xyxy
            self._annotations.append(
                {
                    "id": len(self._annotations) + 1,
                    "image_id": number,
                    "category_id": coco_id(self._categories, target.category),
                    "bbox": [left, top, right - left, bottom - top],
                    "area": int(target.mask.sum()),
                    "segmentation": encode_mask(target.mask),
                    "iscrowd": 0,
                }
            )

    def finish(self) -> None:
        names = [
            {"id": coco_id(self._categories, name), "name": name, "supercategory": "vehicle"}
            for name in self._categories
        ]
        description = {"description": f"{self._dataset.plan.name}, made with rauca", "version": "1"}
        everything = {"info": description, "licenses": [], "categories": names}
        write_json(
            self._out / "annotations.json", everything | {"images": self._images, "annotations": self._annotations}
        )


class _Yolo:
    """YOLO text: class, then center and size of the box as shares of the image's width and height."""

    def __init__(self, out: Path, dataset: Dataset, categories: list[str]) -> None:
        self._out, self._categories = out, categories

    def frame(self, stored: StoredFrame, targets: list[Target]) -> None:
        width, height = stored.frame.camera.width, stored.frame.camera.height
        lines = []
        for target in targets:
            left, top, right, bottom = target.box_xyxy
            center = (left + right) / 2 / width, (top + bottom) / 2 / height
            size = (right - left) / width, (bottom - top) / height
            numbers = " ".join(f"{value:.6f}" for value in (*center, *size))
            lines.append(f"{self._categories.index(target.category)} {numbers}\n")
        write_bytes(self._out / "labels" / f"{stored.frame.id}.txt", "".join(lines).encode())

    def finish(self) -> None:
        names = "".join(f"  {number}: {name}\n" for number, name in enumerate(self._categories))
        text = (
            f"# train and val are the same images: split them by location\ntrain: images\nval: images\nnames:\n{names}"
        )
        write_bytes(self._out / "data.yaml", text.encode())


def _copy(source: Path, target: Path) -> None:
    """A copy, not a link: a tool that edits its images in place must not reach the data set."""
    with disk_errors(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)


def encode_mask(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Uncompressed COCO RLE of an (H, W) mask: runs of unset and set pixels in turn, column after column."""
    columns = np.asarray(mask, bool).T.ravel()
    changes = np.flatnonzero(columns[1:] != columns[:-1]) + 1
    runs = np.diff(np.concatenate([[0], changes, [columns.size]])).tolist()
    return {"size": list(mask.shape), "counts": [0, *runs] if columns[0] else runs}
