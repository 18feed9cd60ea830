"""Every loss of every method: its value by hand, its gradient by finite differences, and both on hard cases."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from benchmarks.stability.detectors import Answering, as_found
from rauca_core.attack import SmoothLoss, attack_loss, box_overlap, detection_score
from rauca_core.attack.das import attention_layer, attention_map, dispersed_attention, smile, watching
from rauca_core.attack.ensemble import DetectorEnsemble
from rauca_core.attack.losses import OBJECTIVES, Predicted, confidence, stealth
from rauca_core.attack.naturalness.palette import cluster
from rauca_core.attack.paint_losses import near_palette, near_seed, smooth_pattern, smooth_picture
from rauca_core.contract import RaucaError
from rauca_core.detect import DensePredictions

TRUTH = torch.tensor([[2.0, 3.0, 12.0, 14.0], [0.0, 0.0, 8.0, 8.0]], dtype=torch.float64)
BY_BOXES = [name for name in OBJECTIVES if name != "attention"]
WITH_A_CONSTANT = ("complete", "every-cell")  # the aspect's weight, as published: see test_published.py


def predicted(boxes: Tensor, objectness: Tensor, classes: Tensor, truth: Tensor = TRUTH) -> Predicted:
    found = DensePredictions(boxes, objectness, classes)
    return Predicted(found, truth, 1, detection_score(found, truth, 1))


def some_boxes() -> tuple[Tensor, Tensor, Tensor]:
    boxes = torch.tensor(
        [[[1.0, 2, 11, 13], [4, 5, 13, 15.5], [50, 50, 60, 60]], [[0.5, 0, 8, 8], [4, 4, 9, 9], [30, 30, 31, 31]]],
        dtype=torch.float64,
    )
    objectness = torch.tensor([[0.7, 0.9, 1.0], [0.2, 0.3, 0.4]], dtype=torch.float64)
    classes = torch.tensor([[0.1, 0.6], [0.95, 0.3], [0.5, 0.9]], dtype=torch.float64).expand(2, 3, 2).clone()
    return boxes, objectness, classes


def test_values_by_hand() -> None:
    boxes, objectness, classes = some_boxes()
    seen = predicted(boxes, objectness, classes)
    # ACTIVE: IoUs of the first picture are 90/130 and 72/132.5 > 0.5; the second box is the likelier one, as a boat.
    assert stealth(seen).tolist() == pytest.approx([-math.log(1 - 0.9 * 0.95), -math.log(1 - 0.2 * 0.6)], rel=1e-4)
    # DTA: the car's class only; the far box, though the likeliest, does not touch the vehicle.
    assert confidence(seen).tolist() == pytest.approx([-math.log(1 - 0.7 * 0.6), -math.log(1 - 0.2 * 0.6)], rel=1e-4)


@pytest.mark.parametrize("name", [name for name in BY_BOXES if name not in WITH_A_CONSTANT])
def test_gradient_by_finite_differences(name: Any) -> None:
    parts = tuple(t.requires_grad_() for t in some_boxes())
    assert torch.autograd.gradcheck(lambda *given: OBJECTIVES[name](predicted(*given)), parts)


def linear_evidence(features: Tensor) -> Tensor:
    """A score whose log-odds are linear: Grad-CAM's weights are then the slopes, whatever the features."""
    slopes = torch.tensor([0.05, -0.025], dtype=features.dtype)[:, None, None].expand(2, 4, 5)
    return (features * slopes).sum((1, 2, 3)).sigmoid()


def test_attention_regions_by_hand() -> None:
    features = torch.zeros(1, 2, 4, 5, dtype=torch.float64)
    features[0, 0, :2, 0], features[0, 0, 3, 3:], features[0, 1, 2, 2] = 0.3, 0.1, 0.7
    features.requires_grad_()
    score = linear_evidence(features)
    found = attention_map(score, features)
    assert torch.allclose(found[0], features[0, 0] - 0.5 * features[0, 1])
    wanted = (2 * math.tanh(0.3) / (21 - 2) + 2 * math.tanh(0.1) / (21 - 2)) / 2  # the negative cell is in no region
    assert dispersed_attention(score, features).item() == pytest.approx(wanted)
    # One large region costs more than its two halves apart.
    whole, halves = torch.zeros(2, 1, 2, 4, 5, dtype=torch.float64)
    whole[0, 0, :2, :4], halves[0, 0, 0, :4], halves[0, 0, 2, :4] = 0.2, 0.2, 0.2
    costs = [dispersed_attention(linear_evidence(f), f) for f in (whole.requires_grad_(), halves.requires_grad_())]
    assert costs[0].item() > costs[1].item()


def test_attention_gradient_by_finite_differences() -> None:
    generator = torch.Generator().manual_seed(1)
    features = torch.randn(2, 2, 4, 5, dtype=torch.float64, generator=generator).mul_(0.2).requires_grad_()
    assert torch.autograd.gradcheck(lambda f: dispersed_attention(linear_evidence(f), f), features)


def test_attention_of_a_network_in_half_precision_is_that_of_the_whole_one() -> None:
    images, box = torch.rand(2, 3, 64, 64, generator=torch.Generator().manual_seed(0)), [8.0, 8.0, 56.0, 56.0]
    whole, half = (
        DetectorEnsemble([Answering(as_found)], "car", None, precision, "attention").attack(
            images, torch.tensor([box, box])
        )
        for precision in ("float32", "bfloat16")
    )
    assert whole.gradient.abs().sum() > 0
    assert torch.allclose(half.losses, whole.losses, rtol=0.1)
    assert (half.gradient - whole.gradient).abs().sum() < 0.2 * whole.gradient.abs().sum()


def test_features_are_those_that_all_heads_share() -> None:
    from rauca_core.detect import load_detector

    try:
        detector = load_detector("yolov3-tiny")
    except RaucaError as error:
        pytest.skip(str(error))
    layer = attention_layer(detector)
    with watching(layer) as seen:
        detector.dense(torch.rand(1, 3, 96, 96))
    assert seen[-1].shape == (1, 256, 13, 13)
    assert not layer._forward_hooks


def pictures(*shape: int) -> Tensor:
    return torch.rand(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(0))


def squares_of_neighbors(image: Tensor, mask: Tensor) -> float:
    """Of (H, W, C) over all pairs beside or below each other inside a mask (H, W)."""
    height, width, total = *mask.shape, 0.0
    for y in range(height):
        for x in range(width):
            for ny, nx in ((y + 1, x), (y, x + 1)):
                if ny < height and nx < width and mask[y, x] and mask[ny, nx]:
                    total += float((image[y, x] - image[ny, nx]).square().sum())
    return total


def test_smoothness_of_pictures_and_maps_counts_pairs_of_paint() -> None:
    images, paint = pictures(2, 3, 5, 6), pictures(2, 5, 6) > 0.4
    total = squares_of_neighbors(images[1].permute(1, 2, 0), paint[1])
    assert float(smooth_picture(images, paint)[1]) == pytest.approx(total / 30)
    assert torch.autograd.gradcheck(lambda i: smooth_picture(i, paint), images.requires_grad_())
    uv_map, mask = pictures(12, 12, 3), pictures(12, 12) < 0.6
    smooth, values = SmoothLoss(np.flatnonzero(mask), 12), uv_map[mask].requires_grad_()
    assert float(smooth(values).detach()) == pytest.approx(squares_of_neighbors(uv_map, mask) / 144)
    assert torch.autograd.gradcheck(smooth, values)
    assert float(smooth(torch.full_like(values, 0.3))) == 0.0


def test_priors_by_hand_and_by_finite_differences() -> None:
    pattern = torch.zeros(2, 2, 3, dtype=torch.float64)
    pattern[0, 0] = torch.tensor([0.3, 0.6, 0.0])
    assert float(smooth_pattern(pattern)) == pytest.approx(-2 * math.log(0.7), rel=1e-5)
    palette = torch.tensor([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], dtype=torch.float64)
    near = near_palette(torch.tensor([[0.9, 0.9, 0.6], [0.1, 0.1, 0.1]], dtype=torch.float64), palette)
    assert float(near) == pytest.approx(-(math.log(0.8) + math.log(0.9)) / 2, rel=1e-5)
    seed, edges = pictures(7, 3), (pictures(7) > 0.5).double()
    wanted = sum((0.9 if e else 0.1) * float((s - 0.5).square().sum()) for s, e in zip(seed, edges, strict=True))
    assert float(near_seed(torch.full_like(seed, 0.5), seed, edges)) == pytest.approx(wanted)
    checks: list[Callable[[Tensor], Tensor]] = [
        lambda t: smooth_pattern(t.reshape(4, 4, 3)),
        lambda t: near_palette(t, palette),
        lambda t: near_seed(t, torch.full_like(t, 0.2), torch.ones_like(t[:, 0])),
    ]
    for check in checks:
        assert torch.autograd.gradcheck(check, pictures(16, 3).requires_grad_())


def test_priors_on_hard_pictures_are_finite() -> None:
    black, none = torch.zeros(1, 3, 4, 4, requires_grad=True), torch.zeros(1, 4, 4, dtype=torch.bool)
    flat, extreme = torch.zeros(4, 4, 3, requires_grad=True), torch.tensor([[0.0], [1.0]]).repeat(8, 3)
    extreme.requires_grad_()
    losses = [
        smooth_picture(black, none).sum(),
        smooth_picture(black, ~none).sum(),
        smooth_pattern(flat),
        smooth_pattern(extreme.reshape(4, 4, 3)),
        near_palette(flat.reshape(-1, 3), torch.ones(1, 3)),
    ]
    for loss in losses:
        assert torch.isfinite(loss)
        gradients = torch.autograd.grad(loss, (black, flat, extreme), allow_unused=True)
        assert all(g is None or torch.isfinite(g).all() for g in gradients)


def test_dominant_colors_are_found() -> None:
    rng = np.random.default_rng(0)
    wanted = np.array([[0.1, 0.1, 0.1], [0.2, 0.8, 0.3], [0.9, 0.9, 1.0]])
    points = np.repeat(wanted, (50, 200, 100), 0) + rng.normal(0, 0.01, (350, 3))
    found = cluster(points, 3, np.random.default_rng(1))
    assert np.allclose(found[np.argsort(found.sum(1))], wanted, atol=0.01)
    assert np.isfinite(cluster(np.full((5, 3), 0.5), 3, rng)).all()  # fewer colors than asked for


def test_seed_picture_smiles() -> None:
    y, x = np.mgrid[1:-1:41j, -1:1:41j]
    colors, lines = smile(np.stack([x.ravel(), y.ravel()], 1), (140, 140, 140))
    colors, lines = colors.reshape(41, 41, 3), lines.reshape(41, 41)
    assert np.allclose(colors[0, 0], 140 / 255)
    assert (colors == colors[:, ::-1]).mean() > 0.99  # but for rounding on its lines
    assert lines[20, 20] == 0
    assert lines[30:, 20].any()
    assert lines[10:16, :20].any()


def test_score_is_the_best_product_of_overlap_class_and_objectness() -> None:
    truth = torch.tensor([[0.0, 0.0, 10.0, 10.0]])
    boxes = torch.tensor([[[0.0, 0, 10, 5], [0, 0, 10, 10], [50, 50, 60, 60]]])
    found = DensePredictions(boxes, torch.tensor([[0.9, 0.4, 1.0]]), torch.tensor([0.0, 0.8]).expand(1, 3, 2))
    assert detection_score(found, truth, 1).tolist() == pytest.approx([0.5 * 0.8 * 0.9])
    assert detection_score(found, truth, 0).tolist() == [0.0]
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
