from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from rauca_core.attack import Augmentation
from rauca_core.attack.augmentation import BACKDROP, FILL, RANGES, AugmentationName
from rauca_core.contract.seeding import named_rng


@pytest.mark.parametrize(("width", "height"), [(96, 96), (140, 90)])
@pytest.mark.parametrize("extra_turn", [0.0, 0.5])
@pytest.mark.parametrize("ranges", ["rauca", "zoomed"])
def test_boxes_move_with_the_picture(width: int, height: int, extra_turn: float, ranges: AugmentationName) -> None:
    """A painted rectangle, found again after the move, fills its moved box; wider turns show skew that 5 deg hides."""
    batch = 24
    boxes = torch.tensor([[32.0, 32.0, 64.0, 52.0]]).repeat(batch, 1)
    images = torch.full((batch, 3, height, width), BACKDROP)
    images[:, :, 32:52, 32:64] = 1.0
    drawn = Augmentation.draw(named_rng("move", width), batch, RANGES[ranges])
    cosine, sine = np.cos(extra_turn), np.sin(extra_turn)
    turned = torch.tensor([[cosine, -sine], [sine, cosine]], dtype=torch.float32) @ drawn.matrix
    roa = Augmentation(turned, torch.zeros(batch), torch.ones(batch))
    moved, found = roa(images, boxes)
    assert len(torch.unique(found, dim=0)) == batch
    for image, box in zip(moved, found, strict=True):
        rows, columns = np.nonzero(image[0].numpy() > BACKDROP + 0.1)
        seen = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        assert np.abs(seen - box.numpy()).max() <= 1.5


def test_boxes_are_cut_to_the_image() -> None:
    roa = Augmentation.draw(named_rng("cut"), 50)
    boxes = roa.move_boxes(torch.tensor([[-5.0, 0.0, 64.0, 70.0]]).repeat(50, 1), 64, 64)
    assert boxes.min() >= 0
    assert boxes.max() <= 64
    assert (boxes[:, 2:] >= boxes[:, :2]).all()


def test_ranges_and_share_of_relit_images() -> None:
    roa = Augmentation.draw(named_rng("ranges"), 4000)
    scale = roa.matrix[:, :, 0].norm(dim=1)
    angle = torch.atan2(roa.matrix[:, 1, 0], roa.matrix[:, 0, 0]).rad2deg()
    assert scale.min() >= 0.7 - 1e-6
    assert scale.max() <= 1.0 + 1e-6
    assert 4.9 < angle.abs().max() <= 5.001
    assert 0.095 < roa.matrix[:, :, 2].abs().max() <= 0.1
    relit = (roa.contrast != 1) | (roa.brightness != 0)
    assert 0.46 < relit.float().mean() < 0.54
    assert roa.brightness.abs().max() <= 0.25
    assert 0.75 <= roa.contrast.min() < roa.contrast.max() <= 1.5


def test_half_of_the_pictures_are_mirrored() -> None:
    roa = Augmentation.draw(named_rng("mirror"), 4000, RANGES["zoomed"])
    sides = torch.linalg.det(roa.matrix[:, :, :2]).sign()
    assert 0.46 < (sides < 0).float().mean() < 0.54
    as_published = Augmentation.draw(named_rng("mirror"), 4000)
    assert (torch.linalg.det(as_published.matrix[:, :, :2]) > 0).all()
    assert torch.equal(roa.brightness, as_published.brightness)  # drawn after the rest, whose stream stays as it was


def test_zoomed_pictures_show_the_vehicle_as_near_as_the_frame_is_sharp() -> None:
    """From 0.6 of the frame to 1.2 of its pixels, evenly in the logarithm; drawn nearer, a vehicle stays."""
    batch, side, shown, ranges = 4000, 640, 320, RANGES["zoomed"]
    generator = torch.Generator().manual_seed(5)
    size = 20 + 300 * torch.rand(batch, 2, generator=generator)
    low = torch.rand(batch, 2, generator=generator) * (side - size)
    boxes = torch.cat([low, low + size], 1)
    roa = Augmentation.draw(named_rng("zoom"), batch, ranges).zoomed(boxes, side, shown, ranges)
    scale = torch.linalg.det(roa.matrix[:, :, :2]).abs().sqrt()
    # Of small vehicles 2.4, of the largest 1.2 sides of a picture.
    highest = (FILL * side / size.amax(1)).clamp(max=2.4)
    share = (scale / 0.6).log() / (highest / 0.6).log()
    assert -1e-5 <= share.min() < 0.01 < 0.99 < share.max() <= 1 + 1e-5
    assert 0.48 < share.mean() < 0.52
    assert scale.max() > 2.3
    moved = roa.move_boxes(boxes, side, side)
    kept = ((moved[:, 2:] - moved[:, :2]) / (scale[:, None] * size)).amin(1)
    fits = (scale[:, None] * size < side).all(1)
    assert kept[fits & (scale > 1)].min() > 0.9  # a turned box may touch the border
    assert kept[scale > 1].min() > 1 / FILL - 0.02


def test_a_zoomed_vehicle_of_no_area_or_beyond_the_frame_is_finite() -> None:
    boxes = torch.tensor([[0.0, 0, 0, 0], [0, 0, 64, 64], [63, 63, 64, 64], [-90, -90, 190, 190]])
    ranges = RANGES["zoomed"]
    roa = Augmentation.draw(named_rng("hard zoom"), 4, ranges).zoomed(boxes, 64, 32, ranges)
    assert torch.isfinite(roa.matrix).all()
    assert (torch.linalg.det(roa.matrix[:, :, :2]).abs().sqrt() >= 0.6 - 1e-5).all()


@pytest.mark.parametrize(("width", "height"), [(64, 64), (50, 34)])
def test_one_pass_is_grid_sample_mean_and_clamp(width: int, height: int) -> None:
    roa = Augmentation.draw(named_rng("one pass", width), 8)
    source = torch.rand(8, 3, height, width, dtype=torch.float64, generator=torch.Generator().manual_seed(2))
    one, two = (source.clone().requires_grad_() for _ in range(2))
    fast, slow = roa(one, torch.zeros(8, 4))[0], roa.relight(roa.move_images(two))
    assert torch.allclose(fast, slow, atol=1e-12)
    assert ((fast == 0) | (fast == 1)).any()  # some of it is clipped
    weights = torch.rand(fast.shape, dtype=torch.float64, generator=torch.Generator().manual_seed(3))
    (fast * weights).sum().backward()
    (slow * weights).sum().backward()
    assert torch.allclose(one.grad, two.grad, atol=1e-12)


def test_black_and_white_keep_their_gradient_where_nothing_is_relit() -> None:
    roa = Augmentation.draw(named_rng("ends"), 4)
    roa = replace(roa, brightness=torch.zeros(4), contrast=torch.ones(4))
    ends = torch.rand(4, 3, 16, 16, dtype=torch.float64, generator=torch.Generator().manual_seed(4)).round()
    one, two = (ends.clone().requires_grad_() for _ in range(2))
    roa(one, torch.zeros(4, 4))[0].sum().backward()
    roa.move_images(two).sum().backward()
    assert torch.allclose(one.grad, two.grad, atol=1e-12)


@pytest.mark.parametrize("value", [0.0, 1.0, float("nan")])
def test_hard_pictures(value: float) -> None:
    roa = Augmentation.draw(named_rng("hard"), 6)
    images = torch.full((6, 3, 9, 9), value, requires_grad=True)
    seen, _ = roa(images, torch.zeros(6, 4))
    assert bool(torch.isnan(seen).any()) == (value != value)  # what is wrong is not hidden
    seen.nan_to_num().sum().backward()
    assert torch.isfinite(images.grad).all()
