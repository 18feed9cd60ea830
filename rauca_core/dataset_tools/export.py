"""``rauca dataset export``: COCO JSON or YOLO labels beside the images, for any trainer or evaluation tool.

::

    coco   OUT/annotations.json, OUT/images/<frame>.png
    yolo   OUT/data.yaml, OUT/train.txt, OUT/val.txt, OUT/images/<frame>.png, OUT/labels/<frame>.txt

In a camouflage a frame is called ``<frame>--<label>``. Every picture of a place is in the same split, ``val`` for the
last quarter of the places; where there is one place alone, it is both. Composed frames are learnt from and never judged
on: they are in ``train``, and those of the last quarter of the places, whose rendered frames judge, are ``unused``.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Frame, Progress, RaucaError
from ..contract.files import disk_errors, png_bytes, require_space, write_bytes, write_json
from .stored import StoredFrame, Target, categories_of, coco_id, load_vehicle, targets_of

FORMATS = ("coco", "yolo")
TRAIN, VAL, UNUSED = "train", "val", "unused"
BYTES_PER_PIXEL = 3
Wearer = Callable[[Frame], NDArray[np.uint8] | None]
"""A frame in a camouflage, (H, W, 3) sRGB; None where that shows nothing of it."""


@dataclass(frozen=True, eq=False)
class Exported:
    """An image that was written as ``images/<name>.png``, and what is to be detected in it.

    Attributes:
        camouflage: its label; empty in the reference paint.
        split: ``train``, ``val`` or ``unused``; empty where a place is both.
    """

    name: str
    frame: Frame
    targets: list[Target]
    camouflage: str
    split: str


def export_dataset(
    folder: Path,
    form: str,
    out: Path,
    progress: Callable[[Progress], None] = lambda _: None,
    worn: Mapping[str, Wearer] | None = None,
) -> int:
    """Write a data set's frames and ground truth in another layout, with copies of the images.

    Args:
        form: ``coco`` or ``yolo``.
        out: a new folder, or one that an earlier export of the same data set filled.
        worn: camouflages by label, in which every frame is written too.

    Returns:
        how many targets were written.

    Raises:
        RaucaError: unknown format, nothing to export, a damaged frame, a disk that is full or too small.
    """
    if form not in FORMATS:
        raise RaucaError(f"format {form!r} is unknown; choose one of {', '.join(FORMATS)}")
    dataset, worn = Dataset(folder), worn or {}
    frames = StoredFrame.all_of(dataset, "export")
    own = load_vehicle(dataset.vehicle_folder).category
    categories = categories_of(frames, own)
    names = [name_of(stored.frame, label) for stored in frames for label in ("", *worn)]
    missing = sum(not (out / "images" / f"{name}.png").is_file() for name in names)
    require_space(out, BYTES_PER_PIXEL * dataset.plan.size**2 * missing)
    write = _write_coco if form == "coco" else _write_yolo
    return write(out, dataset.plan.name, categories, _written(frames, dataset.plan.locations, own, out, progress, worn))


def name_of(frame: Frame, label: str) -> str:
    """What a frame's image is called, in a camouflage of a label or, without one, in its reference paint."""
    return f"{frame.id}--{label}" if label else frame.id


def _written(
    frames: list[StoredFrame],
    places: int,
    own: str,
    out: Path,
    progress: Callable[[Progress], None],
    worn: Mapping[str, Wearer],
) -> Iterator[Exported]:
    """Every frame with its targets, one at a time, its images written."""
    held_out = places - max(1, places // 4)  # of those planned: a data set that grows keeps its split
    for done, stored in enumerate(frames, 1):
        frame, targets = stored.frame, list(targets_of(stored, own))
        judged, learnt = (UNUSED, TRAIN) if frame.composed else (VAL, TRAIN if places > 1 else "")
        split = judged if 0 < held_out <= frame.location else learnt
        image = out / "images" / f"{frame.id}.png"
        with disk_errors(image):  # a copy, not a link: a tool that edits its images must not reach the data set
            image.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(stored.folder / "image.png", image)
        yield Exported(frame.id, frame, targets, "", split)
        for label, wear in worn.items():
            if (pixels := wear(frame)) is not None:
                name = name_of(frame, label)
                write_bytes(image.with_name(f"{name}.png"), png_bytes(pixels))
                yield Exported(name, frame, targets, label, split)
        progress(Progress(done, len(frames), frame.id))


def _write_coco(out: Path, name: str, categories: list[str], exported: Iterable[Exported]) -> int:
    """COCO detection JSON; masks are exact run lengths, holes and occlusion included."""
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number, one in enumerate(exported, 1):
        frame = one.frame
        images.append(
            {
                "id": number,
                "file_name": f"images/{one.name}.png",
                "width": frame.camera.width,
                "height": frame.camera.height,
                "weather": frame.weather.name,
                "location": frame.location,
                "view": frame.view,
                "camouflage": one.camouflage,
                "split": one.split,
                "composed": bool(frame.composed),
            }
        )
        for target in one.targets:
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


def _write_yolo(out: Path, name: str, categories: list[str], exported: Iterable[Exported]) -> int:
    """YOLO text: class, then center and size of the box as shares of the image's width and height."""
    written = 0
    lists: dict[str, list[str]] = {TRAIN: [], VAL: []}
    for one in exported:
        width, height = one.frame.camera.width, one.frame.camera.height
        lines = []
        for target in one.targets:
            left, top, right, bottom = target.box_xyxy
            center = (left + right) / 2 / width, (top + bottom) / 2 / height
            size = (right - left) / width, (bottom - top) / height
            numbers = " ".join(f"{value:.6f}" for value in (*center, *size))
            lines.append(f"{categories.index(target.category)} {numbers}\n")
        write_bytes(out / "labels" / f"{one.name}.txt", "".join(lines).encode())
        for split, listed in lists.items():
            if one.split in ("", split):
                listed.append(f"./images/{one.name}.png\n")
        written += len(lines)
    names = "".join(f"  {number}: {category}\n" for number, category in enumerate(categories))
    for split, listed in lists.items():
        write_bytes(out / f"{split}.txt", "".join(listed).encode())
    told = "train and val are of other places, if there are several"
    if not lists[VAL]:
        told = "composed frames are not judged on: name here the val.txt of an export of the rendered data set"
    text = f"# {told}\ntrain: train.txt\nval: val.txt\nnames:\n{names}"
    write_bytes(out / "data.yaml", text.encode())
    return written


def encode_mask(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Uncompressed COCO RLE of an (H, W) mask: runs of unset and set pixels in turn, column after column."""
    columns = np.asarray(mask, bool).T.ravel()
    changes = np.flatnonzero(columns[1:] != columns[:-1]) + 1
    runs = np.diff(np.concatenate([[0], changes, [columns.size]])).tolist()
    return {"size": list(mask.shape), "counts": [0, *runs] if columns[0] else runs}
