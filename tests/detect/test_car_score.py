from __future__ import annotations

import pytest
import torch

from rauca_core.contract import RaucaError
from rauca_core.detect import DarknetDetector, box_iou, car_score


def test_car_score_is_the_best_prediction_on_the_target(detector: DarknetDetector) -> None:
    torch.manual_seed(1)
    images = torch.rand(3, 3, 48, 64, requires_grad=True)
    found = detector.dense(images)
    targets = found.boxes[torch.arange(3), torch.tensor([5, 40, 90])].detach()
    scores = car_score(detector, images, targets)
    for image in range(3):
        best = 0.0
        for box, objectness, classes in zip(
            found.boxes[image], found.objectness[image], found.classes[image], strict=True
        ):
            if box_iou(box[None], targets[image, None])[0, 0] > 0.3:
                best = max(best, (objectness * classes[1]).item())
        assert best > 0
        assert scores[image].item() == pytest.approx(best)
    scores.sum().backward()
    assert images.grad is not None
    assert images.grad.abs().amax((1, 2, 3)).min() > 0


def test_nothing_on_the_target_scores_zero(detector: DarknetDetector) -> None:
    far = torch.tensor([[1e4, 1e4, 1e4 + 9, 1e4 + 9]])
    assert car_score(detector, torch.rand(1, 3, 64, 64), far).tolist() == [0.0]


def test_an_unknown_category_is_refused(detector: DarknetDetector) -> None:
    with pytest.raises(RaucaError, match="every: knows no class 'tank'"):
        car_score(detector, torch.rand(1, 3, 64, 64), torch.zeros(1, 4), category="tank")
