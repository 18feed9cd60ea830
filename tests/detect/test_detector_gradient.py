"""Gradients of the predictions with respect to the image."""

from __future__ import annotations

import pytest
import torch

from rauca_core.detect import DarknetDetector
from rauca_core.detect.letterbox import Letterbox
from tests.detect.gradients import checked_gradient


def test_gradient_matches_finite_differences(detector: DarknetDetector) -> None:
    torch.manual_seed(0)
    gradient = checked_gradient(detector, torch.rand(2, 3, 40, 52))  # letterboxed: up-sampling and padding
    assert (gradient.abs().sum(1) > 0).float().mean() > 0.95
    assert not any(parameter.requires_grad for parameter in detector.network.parameters())


@pytest.mark.parametrize("value", [0.0, 1.0, 1e4])
def test_gradient_is_finite_on_extreme_images(detector: DarknetDetector, value: float) -> None:
    images = torch.full((1, 3, 64, 64), value, requires_grad=True)
    found = detector.network(images)  # the detector itself refuses values beyond 1
    (found.boxes.sum() + found.objectness.sum() + found.classes.sum()).backward()
    assert images.grad is not None
    assert all(torch.isfinite(t).all() for t in (found.boxes, found.objectness, found.classes, images.grad))


def test_boxes_stay_precise_in_half_precision(detector: DarknetDetector) -> None:
    """bfloat16 counts pixels beyond 256 in twos."""
    images = torch.rand(1, 3, 64, 64, requires_grad=True)
    exact = detector.dense(images)
    with torch.autocast("cpu", torch.bfloat16):
        found = detector.dense(images)
    found.objectness.sum().backward()
    assert found.boxes.dtype == found.objectness.dtype == torch.float32
    assert len(found.boxes.unique()) > 0.95 * len(exact.boxes.unique())
    assert (found.objectness - exact.objectness).abs().max() < 0.05


@pytest.mark.parametrize(("height", "width"), [(416, 416), (640, 480), (300, 1200), (33, 57), (1, 500)])
def test_letterbox_round_trip(height: int, width: int) -> None:
    box = Letterbox(height, width, 416)
    inner_height, inner_width = box.inner
    top, left = box.corner
    assert max(inner_height, inner_width) == 416
    corners = torch.tensor([[left, top, left + inner_width, top + inner_height]], dtype=torch.float64)
    torch.testing.assert_close(
        box.boxes_to_image(corners), torch.tensor([[0, 0, width, height]], dtype=torch.float64), check_dtype=False
    )


def test_letterbox_puts_a_mark_where_the_mapping_says() -> None:
    images = torch.zeros(1, 3, 200, 400)
    images[:, :, 80:120, 300:340] = 1.0
    fitted = Letterbox(200, 400, 416).fit(images)
    inside = fitted[0, 0, 104:312] > 0.5
    rows, columns = inside.any(1).nonzero()[:, 0] + 104, inside.any(0).nonzero()[:, 0]
    found = torch.tensor([[columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]], dtype=torch.float32)
    mapped = Letterbox(200, 400, 416).boxes_to_image(found)
    torch.testing.assert_close(mapped, torch.tensor([[300.0, 80.0, 340.0, 120.0]]), atol=0.6, rtol=0)
    assert (fitted[0, :, 50] == 0.5).all()


def test_letterbox_does_not_touch_a_fitting_image() -> None:
    images = torch.rand(1, 3, 64, 64)
    assert Letterbox(64, 64, 64).fit(images) is images
