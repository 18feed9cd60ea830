"""Which of some finished camouflages hides a vehicle best from a detector, by the neural renderer on training views.

An attack that begins with the best of them gets farther in the same time than one that begins with noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from ..attack import Renderer
from ..contract import Dataset, load_camouflage
from ..contract.schema import Record, read_json
from ..detect import Detector, class_index
from ..render.uv_map import read_uv_map
from .average_precision import Sample, best_score

FILE_NAME = "ranking.json"
FRAMES_AT_ONCE = 8


def rank_camouflages(
    data: Path,
    camouflages: Sequence[Path],
    detector: Detector,
    category: str,
    device: str = "cpu",
    report: Callable[[int, int], None] = lambda done, total: None,
) -> list[float]:
    """The detector's mean best score on the vehicle in each of some camouflages; the lower, the better hidden.

    Args:
        data: a data set with light maps.
        camouflages: of its vehicle; looked up in maps of the largest one's size.
        category: the vehicle's class.
        report: called with how many are done, and of how many.

    Raises:
        RaucaError: composed frames; a damaged camouflage, or one of another vehicle.
    """
    dataset = Dataset(data)
    dataset.require_rendered("camouflages are ranked on")
    loaded = [load_camouflage(path) for path in camouflages]
    size = max(record.size for record, _ in loaded)
    maps = [read_uv_map(image, size) for _, image in loaded]
    render, index = Renderer(dataset, size, device=device), class_index(detector, category)
    means = []
    for done, pixels in enumerate(maps):
        report(done, len(maps))
        texture = torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).to(device).float() / 255
        scores: list[float] = []
        for first in range(0, len(render), FRAMES_AT_ONCE):
            with torch.no_grad():
                images, boxes = render(texture, range(first, min(first + FRAMES_AT_ONCE, len(render))))
            for found, box in zip(detector.detect(images), boxes, strict=True):
                ours = found.labels == index
                kept = found.boxes[ours].double().cpu().numpy(), found.scores[ours].double().cpu().numpy()
                scores.append(best_score(Sample(box.double().cpu().numpy(), *kept)))
        means.append(float(np.mean(scores)))
    return means


@dataclass(frozen=True)
class Ranking(Record):
    """What :func:`rank_camouflages` found, in the order of the camouflages."""

    FORMAT = ("rauca-ranking", 1)

    means: tuple[float, ...]


def best_of(folder: Path, camouflages: Sequence[Path]) -> Path:
    """The camouflage that hides best, of those whose ranking is in a folder."""
    means = Ranking.from_json(read_json(folder / FILE_NAME)).means
    return camouflages[int(np.argmin(means))]
