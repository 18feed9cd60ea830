"""How well a detector finds the cars of frames that it was not trained on, and what it wrongly takes for one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ..contract import Weather
from ..contract.seeding import named_rng
from ..detect.classes import class_index
from ..detect.interface import Detector
from ..detect.nms import box_iou
from .samples import Samples

CAR = "car"
ALL = "all"
SURE = 0.5  # the score of a false alarm
NEAR = 0.3  # overlap with the object that raised it
_BATCH = 8

GROUPS: dict[str, Callable[[Weather], bool]] = {
    "clear day": lambda w: w.sun_altitude_angle >= 0 and w.fog_density <= 5 and w.precipitation == 0,
    "foggy day": lambda w: w.sun_altitude_angle >= 0 and w.fog_density > 5,
    "rainy day": lambda w: w.sun_altitude_angle >= 0 and w.precipitation > 0,
    "night": lambda w: w.sun_altitude_angle < 0,
    "dense fog": lambda w: w.fog_density >= 50,
}


@dataclass(frozen=True, eq=False)
class Judged:
    """One frame: (4,) truth, (M, 4) boxes and (M,) scores of the class, xyxy pixels, float64."""

    truth: NDArray[np.float64]
    boxes: NDArray[np.float64]
    scores: NDArray[np.float64]


Score = Callable[[Sequence[Judged]], float]
"""Average precision at an overlap of 0.5, see `rauca_core.study.average_precision`: it is handed in because
evaluation builds on detectors, and not the other way round."""


@dataclass(frozen=True)
class Findings:
    """What a test came to.

    Attributes:
        ap50: AP@0.5 of cars over ``all`` frames and per group of weathers, in [0, 1].
        by_vehicle: the same per car.
        false_alarms: per object that is no car, the share of frames where it scores above 0.5 as one.
        frames: how many are behind each group and object.
    """

    ap50: dict[str, float]
    by_vehicle: dict[str, float] = field(default_factory=dict)
    false_alarms: dict[str, float] = field(default_factory=dict)
    frames: dict[str, int] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        return asdict(self)


def measure(
    detector: Detector,
    samples: Samples,
    indices: Sequence[int],
    score: Score,
    seed: int = 0,
    device: torch.device | str = "cpu",
) -> Findings:
    """Test on whole frames, each in a plain paint drawn for it by ``seed``; the detector lies on ``device``."""
    label = class_index(detector, CAR)
    judged: dict[str, list[Judged]] = {}
    alarms: dict[str, list[bool]] = {}
    for first in range(0, len(indices), _BATCH):
        chosen = indices[first : first + _BATCH]
        images = torch.stack([samples.plain(i, named_rng(seed, "test paint", i)).image for i in chosen])
        for index, found in zip(chosen, detector.detect(images.to(device)), strict=True):
            frame, vehicle = samples.frames.places[index].frame, samples.frames.vehicle(index)
            assert frame.box_xyxy is not None  # LightFrames has none without
            truth = np.array(frame.box_xyxy)
            boxes, scores = (t[found.labels == label].cpu().double() for t in (found.boxes, found.scores))
            if vehicle.category != CAR:
                overlap = box_iou(boxes, torch.from_numpy(truth)[None])[:, 0]
                alarms.setdefault(vehicle.name, []).append(bool(((scores > SURE) & (overlap > NEAR)).any()))
                continue
            one = Judged(truth, boxes.numpy(), scores.numpy())
            names = [ALL, f"vehicle {vehicle.name}", *(n for n, belongs in GROUPS.items() if belongs(frame.weather))]
            for name in names:
                judged.setdefault(name, []).append(one)
    ap = {name: score(found) for name, found in judged.items()}
    return Findings(
        {name: ap[name] for name in (ALL, *GROUPS) if name in ap},
        {name.removeprefix("vehicle "): value for name, value in sorted(ap.items()) if name.startswith("vehicle ")},
        {name: float(np.mean(raised)) for name, raised in sorted(alarms.items())},
        {n.removeprefix("vehicle "): len(f) for n, f in judged.items()} | {n: len(f) for n, f in alarms.items()},
    )
