"""``rauca bench vehicle``: do detectors take the plain vehicle for a car, from every side?"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from pipelines.console import progress_bar
from pipelines.dataset_options import dataset_job, dataset_parser
from rauca_core.contract import Dataset, RaucaError
from rauca_core.detect import Detector, box_iou, class_index, load_detector
from rauca_core.runtime.blender import run_blender
from rauca_core.runtime.images import read_image

from .harness import Results, Settings

RING = (
    "--weathers single --azimuths 8 --elevations 12 --distances 6.5 --size 416 --samples 8 --no-light --min-visible 0"
)

ON_TARGET = 0.3  # overlap with the truth above which a prediction is on the target


def car_score(detector: Detector, images: Tensor, boxes: Tensor) -> Tensor:
    """Highest objectness * P(car) among the raw predictions on the target: (B,), 0 without any; differentiable.

    Args:
        images: (B, 3, H, W) sRGB in [0, 1].
        boxes: (B, 4) xyxy ground truth, pixels.
    """
    found = detector.dense(images)
    scores = found.objectness * found.classes[..., class_index(detector, "car")]
    return scores.where(box_iou(found.boxes, boxes[:, None])[..., 0] > ON_TARGET, 0.0).amax(1)


def bench(out: Path, vehicle: Sequence[str], detectors: Sequence[str]) -> Results:
    """The best car score of each detector in each view; ``vehicle`` is its options of ``rauca dataset make``."""
    loaded = {name: load_detector(name) for name in detectors}  # a wrong name is told before anything is rendered
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        folder = Path(temporary) / "ring"
        arguments = ["--out", str(folder), *vehicle, *RING.split()]
        with progress_bar("rendering the ring", resumes=False) as move:
            run_blender(dataset_job(dataset_parser().parse_args(arguments)), move)
        dataset = Dataset(folder)
        frames = dataset.frames()
        if any(frame.box_xyxy is None for frame in frames):
            raise RaucaError("the vehicle is not in every view of the ring; check its size, in metres, and its origin")
        pixels = np.stack([read_image(dataset.frame_folder(f.id) / "image.png") for f in frames])
    images = torch.from_numpy(pixels).permute(0, 3, 1, 2).float() / 255
    boxes = torch.tensor([f.box_xyxy for f in frames], dtype=torch.float32)
    results = Results("vehicle", Settings(vehicle=vehicle))
    results.figures["azimuths_deg"] = [frame.azimuth_deg for frame in frames]
    for name, detector in loaded.items():
        scores = car_score(detector, images, boxes).tolist()
        results.add("detectors", name=name, scores=scores, mean=float(np.mean(scores)))
    sides = {f"{frame.azimuth_deg:.0f}°": f"{{scores[{i}]:.2f}}" for i, frame in enumerate(frames)}
    columns = {"detector": "{name}", **sides, "mean": "{mean:.3f}"}
    results.table("car score (azimuth 0: front)", columns, results.rows["detectors"])
    results.publish(out)
    return results
