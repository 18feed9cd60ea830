"""Which of some camouflages hides best, before an attack begins with it."""

from __future__ import annotations

from itertools import combinations, product
from pathlib import Path

import torch
from torch import Tensor

from benchmarks.stability.drawn import make_dataset
from rauca_core.attack import random_camouflage
from rauca_core.contract import Vehicle
from rauca_core.detect import Detections
from rauca_core.study.ranking import rank_camouflages

SIDES = range(0, 65, 8)
SPANS = list(combinations(SIDES, 2))
BOXES = torch.tensor([(x0, y0, x1, y1) for (x0, x1), (y0, y1) in product(SPANS, repeat=2)]).float()


class Brightness:
    """Finds a car everywhere, as surely as the picture is bright."""

    class_names = ("car",)

    def detect(self, images: Tensor) -> list[Detections]:
        labels = torch.zeros(len(BOXES), dtype=torch.long)
        return [Detections(BOXES, image.mean().expand(len(BOXES)), labels) for image in images]


def test_maps_of_different_sizes_are_ranked_together(tmp_path: Path, box_vehicle: Vehicle) -> None:
    data = make_dataset(tmp_path / "data", box_vehicle, 64, (40.0, 130.0)).folder
    # The same four by four cells in maps of 32 and of 64 texels, and other cells.
    for name, size, seed in (("small", 32, 4), ("large", 64, 4), ("other", 32, 5)):
        random_camouflage(tmp_path / f"{name}.json", box_vehicle, size=size, seed=seed, cell=size // 4)
    paints = [tmp_path / f"{name}.json" for name in ("small", "large", "other")]
    small, large, other = rank_camouflages(data, paints, Brightness(), "car")
    assert abs(small - large) < abs(small - other) / 10
