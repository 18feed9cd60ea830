"""``rauca dataset export``: COCO JSON or YOLO labels beside the images, for any trainer or evaluation tool.

::

    coco   OUT/annotations.json, OUT/images/<frame>.png
    yolo   OUT/data.yaml, OUT/images/<frame>.png, OUT/labels/<frame>.txt
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Frame, Progress, RaucaError
from ..contract.files import disk_errors, write_bytes, write_json
from .stored import StoredFrame, Target, categories_of, coco_id, load_vehicle, targets_of

FORMATS = ("coco", "yolo")
Exported = Iterable[tuple[Frame, list[Target]]]


def export_dataset(folder: Path, form: str, out: Path, progress: Callable[[Progress], None] = lambda _: None) -> int:
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
    frames = StoredFrame.all_of(dataset, "export")
    own = load_vehicle(dataset.vehicle_folder).category
    categories = categories_of(frames, own)
    write = _write_coco if form == "coco" else _write_yolo
    return write(out, dataset.plan.name, categories, _copied(frames, own, out, progress))


def _copied(
    frames: list[StoredFrame], own: str, out: Path, progress: Callable[[Progress], None]
) -> Iterator[tuple[Frame, list[Target]]]:
    """Every frame with its targets, one at a time, its image copied."""
    for done, stored in enumerate(frames, 1):
        image = out / "images" / f"{stored.frame.id}.png"
        with disk_errors(image):  # a copy, not a link: a tool that edits its images must not reach the data set
            image.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(stored.folder / "image.png", image)
        yield stored.frame, list(targets_of(stored, own))
        progress(Progress(done, len(frames), stored.frame.id))


def _write_coco(out: Path, name: str, categories: list[str], exported: Exported) -> int:
    """COCO detection JSON; masks are exact run lengths, holes and occlusion included."""
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number, (frame, targets) in enumerate(exported, 1):
        images.append(
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
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": number,
                    "category_id": coco_id(categories, target.category),
                    "bbox": [left, top, right - left, bottom - top],
                    "area": int(target.mask.sum()),
                    "segmentation": encode_mask(target.mask),
                    "iscrowd": 0,
                }
            )
    everything = {
        "info": {"description": f"{name}, made with rauca", "version": "1"},
        "licenses": [],
        "categories": [{"id": coco_id(categories, c), "name": c, "supercategory": "vehicle"} for c in categories],
        "images": images,
        "annotations": annotations,
    }
    write_json(out / "annotations.json", everything)
    return len(annotations)


def _write_yolo(out: Path, name: str, categories: list[str], exported: Exported) -> int:
    """YOLO text: class, then center and size of the box as shares of the image's width and height."""
    written = 0
    for frame, targets in exported:
        width, height = frame.camera.width, frame.camera.height
        lines = []
        for target in targets:
            left, top, right, bottom = target.box_xyxy
            center = (left + right) / 2 / width, (top + bottom) / 2 / height
            size = (right - left) / width, (bottom - top) / height
            numbers = " ".join(f"{value:.6f}" for value in (*center, *size))
            lines.append(f"{categories.index(target.category)} {numbers}\n")
        write_bytes(out / "labels" / f"{frame.id}.txt", "".join(lines).encode())
        written += len(lines)
    names = "".join(f"  {number}: {category}\n" for number, category in enumerate(categories))
    text = f"# train and val are the same images: split them by location\ntrain: images\nval: images\nnames:\n{names}"
    write_bytes(out / "data.yaml", text.encode())
    return written


def encode_mask(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Uncompressed COCO RLE of an (H, W) mask: runs of unset and set pixels in turn, column after column."""
    columns = np.asarray(mask, bool).T.ravel()
    changes = np.flatnonzero(columns[1:] != columns[:-1]) + 1
    runs = np.diff(np.concatenate([[0], changes, [columns.size]])).tolist()
    return {"size": list(mask.shape), "counts": [0, *runs] if columns[0] else runs}
