from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from rauca_core.attack import SmoothLoss, attack_loss, box_overlap, detection_score
from rauca_core.detect import DensePredictions


def predictions(boxes: torch.Tensor, objectness: float | torch.Tensor = 1.0, car: float = 1.0) -> DensePredictions:
    shape = boxes.shape[:2]
    classes = torch.stack([torch.zeros(shape), torch.full(shape, car)], -1)
    return DensePredictions(boxes, torch.as_tensor(objectness).expand(shape), classes)


def test_score_is_the_best_product_of_overlap_class_and_objectness() -> None:
    truth = torch.tensor([[0.0, 0.0, 10.0, 10.0]])
    boxes = torch.tensor([[[0.0, 0, 10, 5], [0, 0, 10, 10], [50, 50, 60, 60]]])
    objectness = torch.tensor([[0.9, 0.4, 1.0]])
    assert detection_score(predictions(boxes, objectness, 0.8), truth, 1).tolist() == pytest.approx([0.5 * 0.8 * 0.9])
    assert detection_score(predictions(boxes, objectness, 0.8), truth, 0).tolist() == [0.0]
    assert float(attack_loss(torch.tensor(0.36))) == pytest.approx(-math.log(1 - 0.36), rel=1e-4)


def test_overlap_against_counting_pixels() -> None:
    rng = np.random.default_rng(0)
    corners = rng.integers(0, 20, (200, 2, 2, 2))
    boxes = np.concatenate([corners.min(2), corners.max(2)], -1)
    for first, second in boxes:
        grids = [np.zeros((20, 20), bool) for _ in range(2)]
        for grid, (x0, y0, x1, y1) in zip(grids, (first, second), strict=True):
            grid[y0:y1, x0:x1] = True
        union = (grids[0] | grids[1]).sum()
        wanted = (grids[0] & grids[1]).sum() / union if union else 0.0
        found = box_overlap(torch.tensor(first[None, None]).float(), torch.tensor(second[None]).float())
        assert float(found) == pytest.approx(wanted, abs=1e-6)


def test_smooth_loss_counts_pairs_inside_the_mask_only() -> None:
    size = 12
    rng = np.random.default_rng(0)
    mask = rng.random((size, size)) < 0.6
    uv_map = torch.from_numpy(rng.random((size, size, 3)))
    total = 0.0
    for y in range(size):
        for x in range(size):
            for ny, nx in ((y + 1, x), (y, x + 1)):
                if ny < size and nx < size and mask[y, x] and mask[ny, nx]:
                    total += float((uv_map[y, x] - uv_map[ny, nx]).square().sum())
    texels = np.flatnonzero(mask)
    smooth = SmoothLoss(texels, size)
    values = uv_map.reshape(-1, 3)[torch.from_numpy(texels)].requires_grad_()
    assert float(smooth(values).detach()) == pytest.approx(total / size**2)
    assert torch.autograd.gradcheck(smooth, values)
    assert float(smooth(torch.full((len(texels), 3), 0.3))) == 0.0
