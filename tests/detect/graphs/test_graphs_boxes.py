"""The stretch to the network's square, and the decoding of boxes."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch

from rauca_core.detect.graphs.ssd import CenterSizeBoxes, stretch

SIZES = [(33, 57), (300, 300), (640, 480), (120, 400), (1, 5)]


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_half_pixel_centers_sample_as_opencv(height: int, width: int, rng: np.random.Generator) -> None:
    image = rng.random((height, width, 3)).astype(np.float32)
    ours = stretch(torch.from_numpy(image).permute(2, 0, 1)[None], 300, half_pixel_centers=True)
    theirs = cv2.resize(image, (300, 300), interpolation=cv2.INTER_LINEAR)
    np.testing.assert_allclose(ours[0].permute(1, 2, 0), theirs, atol=1e-4)


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_whole_pixel_corners_sample_as_tensorflow_1(height: int, width: int, rng: np.random.Generator) -> None:
    image = rng.random((height, width))
    ours = stretch(torch.from_numpy(image)[None, None].expand(1, 3, -1, -1), 300, half_pixel_centers=False)
    y, x = np.arange(300) * height / 300, np.arange(300) * width / 300
    theirs = np.stack([np.interp(x, np.arange(width), row) for row in image])
    theirs = np.stack([np.interp(y, np.arange(height), column) for column in theirs.T]).T
    np.testing.assert_allclose(ours[0, 0], theirs, atol=1e-9)


@pytest.mark.parametrize("half_pixel_centers", [True, False])
def test_a_fitting_image_is_not_touched_and_others_pass_their_gradient(half_pixel_centers: bool) -> None:
    fitting = torch.rand(1, 3, 32, 32)
    assert stretch(fitting, 32, half_pixel_centers) is fitting
    images = torch.rand(1, 3, 12, 20, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x: stretch(x, 17, half_pixel_centers)[:, :1], images)


@pytest.mark.parametrize("rows_first", [True, False])
def test_each_number_moves_its_own_side(rows_first: bool) -> None:
    variances = np.array([0.1, 0.125, 0.2, 0.25])
    decode = CenterSizeBoxes(np.array([[0.5, 0.5, 0.2, 0.4]]), variances, rows_first)
    x, y, w, h = 1.0, -2.0, 0.5, -1.0
    code = torch.tensor([[[y, x, h, w] if rows_first else [x, y, w, h]]])
    left, top, right, bottom = decode(code)[0, 0].tolist()
    assert (left + right) / 2 == pytest.approx(0.5 + 0.1 * 0.2)
    assert (top + bottom) / 2 == pytest.approx(0.5 - 2 * 0.125 * 0.4)
    assert right - left == pytest.approx(0.2 * np.exp(0.1))
    assert bottom - top == pytest.approx(0.4 * np.exp(-0.25))


def test_wild_encodings_keep_finite_gradients() -> None:
    decode = CenterSizeBoxes(np.full((1, 4), 0.5), np.full(4, 0.2), rows_first=False)
    code = torch.full((1, 1, 4), 1e6, requires_grad=True)
    boxes = decode(code)
    boxes.sum().backward()
    assert torch.isfinite(boxes).all()
    assert code.grad is not None
    assert torch.isfinite(code.grad).all()
