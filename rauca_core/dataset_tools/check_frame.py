"""One frame's folder: are its bytes those that were written, and do its files agree with each other and the plan?

Each ``check_...`` rule reports (file, what is wrong) and goes on.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Frame, Plan, PlannedFrame, RaucaError, Vehicle, load_frame
from ..contract.clips import Clips, clip_name
from ..contract.color import linear_to_srgb, recolor, srgb_to_linear
from ..contract.files import SUMS_FILE, file_digest, read_sums
from ..contract.semantics import CLASS_IDS, CLASSES, TARGET_INSTANCE, VEHICLE_CLASSES, find_instances, mask_box
from .stored import GREY, StoredFrame

RENDER_AGAIN = "check with --remove-damaged and run the same `rauca dataset make` again"
MAKE_AGAIN = "make the data set again in another folder"
OTHER_SCENE = (
    "take it out of the scene, or give it its own `rauca_category`, and make the data set again in another folder"
)

Report = Callable[[str, str], None]
"""Takes a file's name and what is wrong with it."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong.

    Attributes:
        file: path below the data set's folder.
        what: is wrong with it.
        remedy: what to do about it.
        again: folder below the data set's that `rauca dataset make` makes again once it is gone; "" if none.
    """

    file: str
    what: str
    remedy: str
    again: str = ""

    def __str__(self) -> str:
        return f"{self.file}: {self.what}; {self.remedy}"


LIGHT_MAPS = ("A", "B")


@dataclass(frozen=True)
class FrameResult:
    """What the examination of one frame gave.

    Attributes:
        findings: what is wrong; empty when all is well.
        squared_error, values: of the recoloring check in display space; zero values without one.
    """

    findings: list[Finding]
    squared_error: float = 0.0
    values: int = 0


def check_frame(dataset: Dataset, planned: PlannedFrame, vehicle: Vehicle | None) -> FrameResult:
    """Read every byte of a frame and hold its files against each other and the plan."""
    folder, name, findings = dataset.frame_folder(planned.id), f"frames/{planned.id}", list[Finding]()

    def report(file: str, what: str) -> None:
        findings.append(Finding(f"{name}/{file}", what, RENDER_AGAIN, again=name))

    checksums(report, folder)
    if findings:  # bytes that changed would only be found again under other names
        return FrameResult(findings)
    try:
        stored = StoredFrame(folder, load_frame(folder))
        findings += _of_own_class(stored.frame, vehicle)
        return FrameResult(findings, *_contents(report, stored, planned, dataset.plan, vehicle))
    except RaucaError as error:
        told = str(error).removeprefix(f"{folder}/")
        file, _, what = told.partition(": ")
        report(file if what else "", what or told)
        return FrameResult(findings)


def _of_own_class(frame: Frame, vehicle: Vehicle | None) -> list[Finding]:
    """No other vehicle is of the vehicle's own class; a scene has it, so rendering again would not help."""
    own = None if vehicle is None else vehicle.category
    if all(other.category != own for other in frame.instances):
        return []
    what = f"another vehicle is a {own}, as the data set's own is: whoever finds it is said to be wrong"
    return [Finding(f"frames/{frame.id}/frame.json", what, OTHER_SCENE)]


def _contents(
    report: Report, stored: StoredFrame, planned: PlannedFrame, plan: Plan, vehicle: Vehicle | None
) -> tuple[float, int]:
    """Hold the files against each other; returns the recoloring check's squared error and number of values."""
    frame = stored.frame
    check_metadata(report, frame, planned, plan, vehicle)
    pictures = ["image.png"] + (["check.png"] if frame.check_srgb is not None else [])
    images = {name: stored.image(name) for name in (*pictures, *GREY)}
    maps = stored.maps("distance", *(LIGHT_MAPS if plan.light else ()))
    wrong = 0
    for name, array in (images | maps).items():
        shape = (plan.size, plan.size) if name in (*GREY, "distance") else (plan.size, plan.size, 3)
        if name in images and array.shape != shape:
            report(name, f"has shape {array.shape}, expected {shape}")
        elif name in maps and (array.shape != shape or array.dtype != np.float16):
            report("passes.npz", f"{name} is {array.dtype} {array.shape}, expected float16 {shape}")
        else:
            continue
        wrong += 1
    if wrong:
        return 0.0, 0
    coverage, paint, semantic = images["vehicle.png"], images["paint.png"], images["semantic.png"]
    check_coverage(report, frame, coverage, paint)
    check_ids(report, frame, semantic, images["instances.png"], coverage)
    check_distances(report, maps["distance"], semantic)
    for name in pictures if plan.light else pictures[:1]:
        check_picture(report, name, images[name])
    if plan.light:
        check_light(report, plan, maps, paint, images["image.png"], exactly=not frame.pictured)
    if not plan.light or frame.check_srgb is None:
        return 0.0, 0
    return squared_error(frame, maps, paint, images["check.png"])


def checksums(report: Report, folder: Path, names: set[str] | None = None) -> None:
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


Image = NDArray[np.uint8]
EDGE_SHARE = 0.01  # of the vehicle's pixels: where ids (a point) and coverage (an area) may honestly differ
IMAGE_TOLERANCE = 3  # of 255: float16 light maps against the 8-bit image they were stored with
POSITION_TOLERANCE_M = 1e-3


def check_metadata(report: Report, frame: Frame, planned: PlannedFrame, plan: Plan, vehicle: Vehicle | None) -> None:
    """``frame.json`` says what the plan asked for."""
    file = "frame.json"
    if (frame.location, frame.view, frame.weather) != (planned.location, planned.view, planned.weather):
        report(file, f"location, view or weather is not that of {planned.id} in the plan")
    if (frame.camera.width, frame.camera.height) != (plan.size, plan.size):
        report(file, f"camera of {frame.camera.width}x{frame.camera.height} pixels, the plan says {plan.size}")
    if frame.visible < plan.min_visible:
        report(file, f"visible is {frame.visible:.3f}, below the plan's limit of {plan.min_visible:g}")
    if plan.clips is not None:
        _within_clip(report, frame, plan.clips)
    elif not frame.pictured:  # whose photographer knew no plan
        _within_ring(report, frame, plan)
    if vehicle is not None:
        _camera_stands(report, frame, vehicle)


def _within_clip(report: Report, frame: Frame, clips: Clips) -> None:
    _, time = clips.at(frame.view)
    if frame.clip != clip_name(clips, frame.location, frame.view, frame.weather.name) or frame.time_s != time:
        report("frame.json", "clip or time_s is not that of the plan")


def _within_ring(report: Report, frame: Frame, plan: Plan) -> None:
    ring, slack = plan.ring, 1e-6
    azimuth, elevation, distance = ring.nominal(frame.view)
    turned = abs((frame.azimuth_deg - azimuth + 180) % 360 - 180)
    lifted = abs(frame.elevation_deg - min(elevation, 89.0))
    if turned > ring.jitter_azimuth_deg + slack or lifted > ring.jitter_elevation_deg + slack:
        report("frame.json", f"azimuth or elevation lies outside view {frame.view} of the plan's ring")
    if abs(frame.distance_m - distance) > ring.jitter_distance * distance + slack:
        report("frame.json", f"distance_m lies outside view {frame.view} of the plan's ring")


def _camera_stands(report: Report, frame: Frame, vehicle: Vehicle) -> None:
    center = (vehicle.positions.min(axis=0) + vehicle.positions.max(axis=0)) / 2
    azimuth, elevation = math.radians(frame.azimuth_deg), math.radians(frame.elevation_deg)
    flat = frame.distance_m * math.cos(elevation)
    height = frame.distance_m * math.sin(elevation)
    expected = center + np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), height])
    found = frame.camera_in_vehicle.position
    off = np.abs(found - expected)
    low = found[2] > expected[2]  # the ring keeps cameras above the ground
    if off[:2].max() > POSITION_TOLERANCE_M or (off[2] > POSITION_TOLERANCE_M and not low):
        report("frame.json", "the camera does not stand where azimuth, elevation and distance say")


def check_picture(report: Report, name: str, image: Image) -> None:
    """A photograph shows something."""
    if image.min() == image.max():
        report(name, f"every pixel has the value {image.min()}")
    elif np.percentile(image, 99) < 2:
        report(name, "black but for a few pixels")


def check_coverage(report: Report, frame: Frame, vehicle: Image, paint: Image) -> None:
    """The box is the mask's, and paint is part of the vehicle."""
    box = mask_box(vehicle >= 128)
    if box != frame.box_xyxy:
        report("frame.json", f"box_xyxy {_box(frame.box_xyxy)} is not vehicle.png's {_box(box)}")
    beyond = int((paint.astype(int) > vehicle.astype(int) + 1).sum())
    if beyond:
        report("paint.png", f"{beyond} pixels have more paint than vehicle")


def check_ids(report: Report, frame: Frame, semantic: Image, instances: Image, vehicle: Image) -> None:
    """Ids are known ones, agree with each other, with coverage and with the list in ``frame.json``."""
    if semantic.max() >= len(CLASSES):
        report("semantic.png", f"class {semantic.max()} does not exist")
    ours = instances == TARGET_INSTANCE
    parts = np.isin(semantic, [CLASS_IDS[name] for name in VEHICLE_CLASSES])
    if (ours != parts).any():
        report("instances.png", f"{int((ours != parts).sum())} pixels differ from semantic.png on what is the vehicle")
    wrong = int((ours[vehicle == 0]).sum() + (~ours[vehicle == 255]).sum())
    if wrong > 4 + EDGE_SHARE * (vehicle > 0).sum():
        report("instances.png", f"{wrong} pixels differ from vehicle.png on what is the vehicle")
    listed = {instance.id: instance for instance in frame.instances}
    if len(listed) != len(frame.instances):
        report("frame.json", "two instances share an id")
    named = {number: listed[number].category if number in listed else "?" for number in range(1, TARGET_INSTANCE)}
    if find_instances(instances, named) != tuple(listed[number] for number in sorted(listed)):
        report("frame.json", "instances are not those of instances.png")


def check_distances(report: Report, distance: NDArray[np.floating], semantic: Image) -> None:
    """Metres are positive, and infinite only in the sky."""
    if np.isnan(distance).any() or (distance <= 0).any():
        report("passes.npz", "distance holds values that are no distance")
    elif (np.isfinite(distance) & (semantic == CLASS_IDS["sky"])).mean() > EDGE_SHARE * 5:
        report("passes.npz", "distance is finite where semantic.png shows sky")


def check_light(
    report: Report, plan: Plan, maps: dict[str, NDArray[np.floating]], paint: Image, image: Image, exactly: bool
) -> None:
    """Light maps are finite, no light is negative, A is zero off the paint, and they predict the stored image.

    Args:
        exactly: hold the prediction against the image; the paint of a picture from elsewhere has not one color alone.
    """
    A, B = maps["A"].astype(np.float32), maps["B"].astype(np.float32)
    for name, array in (("A", A), ("B", B)):
        if not np.isfinite(array).all():
            report("passes.npz", f"{name} holds NaN or infinity")
            return
        if array.min() < 0:
            report("passes.npz", f"{name} holds negative light")
    stray = int((A[paint == 0] != 0).any(axis=-1).sum())
    if stray:
        report("passes.npz", f"A is not zero at {stray} pixels without paint")
    if not exactly:
        return
    predicted = linear_to_srgb(A * srgb_to_linear(np.array(plan.reference_srgb) / 255) + B) * 255
    wrong = (np.abs(predicted - image) > IMAGE_TOLERANCE).any(axis=-1)
    if wrong.mean() > 1e-3:
        report("image.png", f"{int(wrong.sum())} pixels are not what A and B give in the reference paint")


def squared_error(frame: Frame, maps: dict[str, NDArray[np.floating]], paint: Image, check: Image) -> tuple[float, int]:
    """Sum of squared display-space differences between predicted and rendered color, and how many, on the paint."""
    assert frame.check_srgb is not None
    painted = paint >= 128
    predicted = linear_to_srgb(recolor(maps["A"][painted][None], maps["B"][painted][None], frame.check_srgb)[0])
    difference = predicted.astype(np.float64) - check[painted] / 255
    return float((difference**2).sum()), difference.size


def _box(box: tuple[float, ...] | None) -> str:
    return "null" if box is None else "[" + ", ".join(f"{v:g}" for v in box) + "]"
