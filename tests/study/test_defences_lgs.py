"""Local gradients smoothing against the paper's formulas written out pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from rauca_core.study.defences.lgs import LocalGradientsSmoothing


def slow_lgs(
    image: NDArray[np.float64], block: int, overlap: int, threshold: float, smoothing: float
) -> NDArray[np.float64]:
    """(3, H, W) -> (3, H, W), one pixel and one block at a time."""
    _, height, width = image.shape
    gradient = np.zeros((height, width))
    for y in range(height):
        for x in range(width):
            for channel in image:
                dx = channel[y, x + 1] - channel[y, x] if x + 1 < width else 0.0
                dy = channel[y + 1, x] - channel[y, x] if y + 1 < height else 0.0
                gradient[y, x] += dx**2 + dy**2
    gradient = np.sqrt(gradient)
    gradient = (gradient - gradient.min()) / max(np.ptp(gradient), 1e-30)
    kept = np.zeros_like(gradient)
    tops, lefts = (_starts(size, block, overlap) for size in (height, width))
    for top in tops:
        for left in lefts:
            part = (slice(top, top + block), slice(left, left + block))
            if gradient[part].mean() > threshold:
                kept[part] = gradient[part]
    return image * (1 - np.clip(smoothing * kept, 0, 1))


def _starts(size: int, block: int, overlap: int) -> list[int]:
    starts = [0]
    while starts[-1] + block < size:
        starts.append(min(starts[-1] + block - overlap, size - block))
    return starts


@pytest.mark.parametrize(("block", "overlap"), [(15, 5), (9, 0), (4, 3), (1, 0)])
@pytest.mark.parametrize("shape", [(47, 61), (15, 15), (33, 16)])
def test_lgs_is_the_formula(block: int, overlap: int, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    image = np.broadcast_to(np.linspace(0.2, 0.6, shape[1]), (3, *shape)).copy()
    image[:, 5:14, 3:12] = rng.random((3, 9, 9))
    image[:, shape[0] - 6 :, shape[1] - 5 :] = rng.random((3, 6, 5))
    found = LocalGradientsSmoothing(block=block, overlap=overlap)(torch.from_numpy(image)[None])[0].numpy()
    expected = slow_lgs(image, block, overlap, 0.1, 2.3)
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.abs(expected - image).max() > 0.1  # the reference did something


@pytest.mark.parametrize("level", [0.0, 0.5, 1.0])
def test_the_gradient_is_finite_where_the_image_is_flat(level: float) -> None:
    images = torch.full((1, 3, 32, 32), level)
    images[..., 8:16, 8:16] = torch.rand(1, 3, 8, 8, generator=torch.Generator().manual_seed(0))
    for hard in (images, torch.full((1, 3, 32, 32), level)):
        hard.requires_grad_()
        LocalGradientsSmoothing()(hard).sum().backward()
        assert hard.grad is not None
        assert bool(torch.isfinite(hard.grad).all())


def test_the_gradient_is_that_of_the_formula() -> None:
    generator = torch.Generator().manual_seed(0)
    images = torch.rand(1, 3, 10, 9, dtype=torch.float64, generator=generator).requires_grad_()
    # A factor below 1 keeps clear of the clip, and block 4 has blocks on either side of the threshold.
    assert torch.autograd.gradcheck(LocalGradientsSmoothing(block=4, overlap=2, threshold=0.45, smoothing=0.9), images)
