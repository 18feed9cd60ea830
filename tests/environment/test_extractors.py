"""What both extractors and their losses say; the frames that break others are hard cases of `benchmarks.stability`."""

from __future__ import annotations

import pytest
import torch

from benchmarks.stability.light import GREY, frames
from rauca_core.environment.extractor import CLIPPED, LightSplitter, PublishedEfe
from rauca_core.environment.losses import tone, vehicle_weight, weighted_bce
from rauca_core.render.composite import linear_to_srgb, srgb_to_linear


def test_what_the_network_says_does_not_depend_on_the_exposure():
    torch.manual_seed(0)
    net = LightSplitter()
    torch.nn.init.normal_(net.head.weight, std=0.1)
    linear = srgb_to_linear(frames("plain")[0]) * 0.4
    mask = frames("plain")[1]
    A, _ = net(linear_to_srgb(linear), mask, GREY)
    net_stops = [net(linear_to_srgb(linear * factor), mask, GREY)[0] / factor for factor in (0.5, 2.0)]
    # Only the channel that tells the exposure itself differs.
    assert all(((other - A).abs().mean() / A.mean()) < 0.2 for other in net_stops)


@pytest.mark.parametrize("albedo", [0.0, 0.01, 0.26])
def test_the_reference_comes_back_in_channels_that_are_not_clipped(albedo):
    torch.manual_seed(0)
    net = LightSplitter()
    torch.nn.init.normal_(net.head.weight)
    image, mask = frames("plain")
    assert ((image >= CLIPPED).any(1) & (image < CLIPPED).any(1)).any()  # clipped in some channels only
    reference = torch.full((2, 3), albedo)
    A, B = net(image, mask, reference)
    again = linear_to_srgb(A * reference[:, :, None, None] + B)
    assert torch.allclose(again[image < CLIPPED], image[image < CLIPPED], atol=1e-5)
    assert again[image >= CLIPPED].min() >= CLIPPED - 1e-5
    assert B.min() >= 0


def test_the_weight_is_eq_5():
    mask = torch.zeros(3, 1, 10, 20)
    mask[0, :, :5, :10] = 1.0
    mask[1, :, 0, 0] = 1.0
    assert vehicle_weight(mask).tolist() == [4.0, 200.0, 0.0]


def test_bce_is_torchs_away_from_the_ends():
    generator = torch.Generator().manual_seed(0)
    x, target = torch.rand(2, 2, 3, 8, 8, generator=generator) * 0.8 + 0.1
    mask = torch.ones(2, 1, 8, 8)
    expected = torch.nn.functional.binary_cross_entropy(x, target)
    assert weighted_bce(x, target, mask) == pytest.approx(expected.item(), abs=2e-4)


def test_the_tone_is_the_displays_and_never_flat():
    x = torch.linspace(0, 1, 1001, dtype=torch.float64)
    assert torch.allclose(tone(x), linear_to_srgb(x))
    bright = torch.tensor([1.0, 2.0, 1e4], dtype=torch.float64, requires_grad=True)
    tone(bright).sum().backward()
    assert (bright.grad > 0.4).all()
    assert torch.autograd.gradcheck(tone, torch.tensor([1e-3, 0.1, 0.9, 3.0], dtype=torch.float64, requires_grad=True))


def test_sizes():
    count = lambda net: sum(p.numel() for p in net.parameters())  # noqa: E731
    assert count(PublishedEfe()) == pytest.approx(34.5e6, rel=2e-3)
    assert count(LightSplitter()) < count(PublishedEfe()) / 40
