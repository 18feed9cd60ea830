"""One frame's folder under examination."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Frame, PlannedFrame, RaucaError, Vehicle, load_frame
from ..contract.checksums import SUMS_FILE, file_digest, read_sums
from . import frame_rules as rules
from .findings import OTHER_SCENE, RENDER_AGAIN, Finding
from .stored_frame import GREY, StoredFrame

LIGHT_MAPS = ("A", "B")


@dataclass(frozen=True)
class FrameResult:
    """What the examination of one frame gave.

    Attributes:
        findings: what is wrong; empty when all is well.
        squared_error, values: of the recoloring check in display space; zero values without one.
    """

    findings: tuple[Finding, ...] = ()
    squared_error: float = 0.0
    values: int = 0


def check_frame(dataset: Dataset, planned: PlannedFrame, vehicle: Vehicle | None) -> FrameResult:
    """Read every byte of a frame and hold its files against each other and the plan."""
    return _Examination(dataset, planned, vehicle).result()


class _Examination:
    def __init__(self, dataset: Dataset, planned: PlannedFrame, vehicle: Vehicle | None) -> None:
        self._dataset, self._planned, self._vehicle = dataset, planned, vehicle
        self._folder = dataset.frame_folder(planned.id)
        self._findings: list[Finding] = []

    def result(self) -> FrameResult:
        checksums(self._report, self._folder)
        if self._findings:  # bytes that changed would only be found again under other names
            return FrameResult(tuple(self._findings))
        try:
            squared_error, values = self._contents()
        except RaucaError as error:
            told = str(error).removeprefix(f"{self._folder}/")
            file, _, what = told.partition(": ")
            self._report(file if what else "", what or told)
            return FrameResult(tuple(self._findings))
        return FrameResult(tuple(self._findings), squared_error, values)

    def _report(self, file: str, what: str) -> None:
        frame = f"frames/{self._planned.id}"
        self._findings.append(Finding(f"{frame}/{file}", what, RENDER_AGAIN, again=frame))

    def _contents(self) -> tuple[float, int]:
        """Hold the files against each other; returns the recoloring check's squared error and number of values."""
        frame, plan = load_frame(self._folder), self._dataset.plan
        rules.metadata(self._report, frame, self._planned, plan, self._vehicle)
        self._only_one(frame)
        images = self._images(frame)
        stored = StoredFrame(self._folder, frame)
        maps = stored.maps("distance", *(LIGHT_MAPS if plan.light else ()))
        if not self._right_shapes(images, maps):
            return 0.0, 0
        vehicle, paint, semantic = images["vehicle.png"], images["paint.png"], images["semantic.png"]
        rules.coverage(self._report, frame, vehicle, paint)
        rules.ids(self._report, frame, semantic, images["instances.png"], vehicle)
        rules.distances(self._report, maps["distance"], semantic)
        rules.picture(self._report, "image.png", images["image.png"])
        if not plan.light:
            return 0.0, 0
        rules.light(self._report, plan, maps, paint, images["image.png"])
        if frame.check_srgb is None:
            return 0.0, 0
        rules.picture(self._report, "check.png", images["check.png"])
        return rules.squared_error(frame, maps, paint, images["check.png"])

    def _only_one(self, frame: Frame) -> None:
        """No other vehicle is of the vehicle's own class; a scene has it, so rendering again would not help."""
        own = None if self._vehicle is None else self._vehicle.category
        if any(other.category == own for other in frame.instances):
            what = f"another vehicle is a {own}, as the data set's own is: whoever finds it is said to be wrong"
            self._findings.append(Finding(f"frames/{frame.id}/frame.json", what, OTHER_SCENE))

    def _images(self, frame: Frame) -> dict[str, NDArray[np.uint8]]:
        names = ["image.png", *GREY] + ([] if frame.check_srgb is None else ["check.png"])
        return {name: StoredFrame(self._folder, frame).image(name) for name in names}

    def _right_shapes(self, images: dict[str, NDArray[np.uint8]], maps: dict[str, NDArray[np.generic]]) -> bool:
        size = self._dataset.plan.size
        before = len(self._findings)
        for name, image in images.items():
            wanted = (size, size) if name in GREY else (size, size, 3)
            if image.shape != wanted:
                self._report(name, f"has shape {image.shape}, expected {wanted}")
        for name, array in maps.items():
            wanted = (size, size) if name == "distance" else (size, size, 3)
            if array.shape != wanted or array.dtype != np.float16:
                self._report("passes.npz", f"{name} is {array.dtype} {array.shape}, expected float16 {wanted}")
        return len(self._findings) == before


def checksums(report: rules.Report, folder: Path, names: set[str] | None = None) -> None:
    """Hold the files of a folder against its ``SHA256SUMS``.

    Args:
        names: files that must be listed, relative to ``folder``; all that lie in it by default.
    """
    try:
        sums = read_sums(folder)
    except RaucaError as error:
        report(SUMS_FILE, str(error).removeprefix(f"{folder}/{SUMS_FILE}: "))
        return
    present = {path.name for path in folder.iterdir()} - {SUMS_FILE} if names is None else names
    for name in sorted(present - set(sums)):
        report(name, "is not among the files that SHA256SUMS lists")
    for name, digest in sums.items():
        path = folder / name
        if not os.path.isfile(path):  # Path would raise for a name too long for any disk
            report(name, "missing")
        elif file_digest(path) != digest:
            report(name, "its bytes are not those that were written (checksum)")
