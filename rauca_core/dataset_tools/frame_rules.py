"""What must hold between the files of one frame. Each rule reports (file, what is wrong) and goes on."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..contract import Frame, Plan, PlannedFrame, Vehicle
from ..contract.color import linear_to_srgb, srgb_to_linear
from ..contract.instances import find_instances, mask_box
from ..contract.recolor import recolor
from ..contract.semantics import CLASS_IDS, CLASSES, TARGET_INSTANCE, VEHICLE_CLASSES
from .findings import Report

Image = NDArray[np.uint8]
EDGE_SHARE = 0.01  # of the vehicle's pixels: where ids (a point) and coverage (an area) may honestly differ
IMAGE_TOLERANCE = 3  # of 255: float16 light maps against the 8-bit image they were stored with
POSITION_TOLERANCE_M = 1e-3


def metadata(report: Report, frame: Frame, planned: PlannedFrame, plan: Plan, vehicle: Vehicle | None) -> None:
    """``frame.json`` says what the plan asked for."""
    file = "frame.json"
    if (frame.location, frame.view, frame.weather) != (planned.location, planned.view, planned.weather):
        report(file, f"location, view or weather is not that of {planned.id} in the plan")
    if (frame.camera.width, frame.camera.height) != (plan.size, plan.size):
        report(file, f"camera of {frame.camera.width}x{frame.camera.height} pixels, the plan says {plan.size}")
    if frame.visible < plan.min_visible:
        report(file, f"visible is {frame.visible:.3f}, below the plan's limit of {plan.min_visible:g}")
    _within_ring(report, frame, plan)
    if vehicle is not None:
        _camera_stands(report, frame, vehicle)


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


def picture(report: Report, name: str, image: Image) -> None:
    """A photograph shows something."""
    if image.min() == image.max():
        report(name, f"every pixel has the value {image.min()}")
    elif np.percentile(image, 99) < 2:
        report(name, "black but for a few pixels")


def coverage(report: Report, frame: Frame, vehicle: Image, paint: Image) -> None:
    """The box is the mask's, and paint is part of the vehicle."""
    box = mask_box(vehicle >= 128)
    if box != frame.box_xyxy:
        report("frame.json", f"box_xyxy {_box(frame.box_xyxy)} is not vehicle.png's {_box(box)}")
    beyond = int((paint.astype(int) > vehicle.astype(int) + 1).sum())
    if beyond:
        report("paint.png", f"{beyond} pixels have more paint than vehicle")


def ids(report: Report, frame: Frame, semantic: Image, instances: Image, vehicle: Image) -> None:
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


def distances(report: Report, distance: NDArray[np.floating], semantic: Image) -> None:
    """Metres are positive, and infinite only in the sky."""
    if np.isnan(distance).any() or (distance <= 0).any():
        report("passes.npz", "distance holds values that are no distance")
    elif (np.isfinite(distance) & (semantic == CLASS_IDS["sky"])).mean() > EDGE_SHARE * 5:
        report("passes.npz", "distance is finite where semantic.png shows sky")


def light(report: Report, plan: Plan, maps: dict[str, NDArray[np.floating]], paint: Image, image: Image) -> None:
    """Light maps are finite, no light is negative, A is zero off the paint, and they predict the stored image."""
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
