"""Both extractors and their losses on the frames that break others."""

from __future__ import annotations

import pytest
import torch

from rauca_core.environment.extractor import LightSplitter
from rauca_core.environment.focus import split_light, surroundings
from rauca_core.environment.losses import light_loss, tone, vehicle_weight, weighted_bce, weighted_mse
from rauca_core.environment.published import PublishedEfe, fuse_published
from rauca_core.render.composite import display, undisplay

SIZE = 37  # no multiple of anything
GREY = torch.full((2, 3), 0.26)


def frames(kind: str) -> tuple[torch.Tensor, torch.Tensor]:
    """Two frames (2, 3, H, W) and masks (2, 1, H, W) of a kind that happens."""
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(2, 3, SIZE, SIZE, generator=generator)
    mask = torch.zeros(2, 1, SIZE, SIZE)
    mask[:, :, 8:30, 5:33] = 1.0
    if kind == "black":
        image = torch.zeros_like(image)
    if kind == "white":
        image = torch.ones_like(image)
    if kind == "one pixel":
        mask = torch.zeros_like(mask)
        mask[:, :, 20, 20] = 1.0
    if kind == "no vehicle":
        mask = torch.zeros_like(mask)
    if kind == "faint edge":
        mask = mask * 1e-3
    return image, mask


KINDS = ["plain", "black", "white", "one pixel", "no vehicle", "faint edge"]


@pytest.mark.parametrize("kind", KINDS)
def test_our_maps_are_finite_and_give_the_reference_back(kind):
    torch.manual_seed(0)
    net = LightSplitter()
    torch.nn.init.normal_(net.head.weight)
    image, mask = frames(kind)
    A, B = net(image, mask, GREY)
    assert A.isfinite().all()
    assert B.isfinite().all()
    assert (A >= 0).all()
    assert (B >= 0).all()
    assert (A[(mask == 0).expand_as(A)] == 0).all()
    unclipped = (image.amax(dim=1, keepdim=True) < 0.98).expand_as(A)
    again = display(A * GREY[:, :, None, None] + B)
    assert torch.allclose(again[unclipped], image[unclipped], atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_a_frame_is_lit_around_its_vehicle(kind):
    torch.manual_seed(0)
    net = LightSplitter()
    torch.nn.init.normal_(net.head.weight)
    images, masks = frames(kind)
    wide = [torch.nn.functional.pad(t[0], (60, 60, 70, 30), value=v) for t, v in ((images, 0.4), (masks, 0.0))]
    A, B = split_light(net, *wide, GREY[0])
    assert A.isfinite().all()
    assert (A[(wide[1] == 0).expand_as(A)] == 0).all()
    window = surroundings(wide[1][0] > 0)
    if window is None:
        assert kind == "no vehicle"
        assert torch.equal(B, undisplay(wide[0]))
        return
    inside = (..., *window)
    alone = net(wide[0][inside][None], wide[1][inside][None], GREY[:1])
    assert torch.equal(A[inside], alone[0][0])
    assert (wide[1].sum() - wide[1][inside].sum()).abs() < 1e-6
    assert B[0, 0, 0] == undisplay(torch.tensor(0.4))


def test_what_the_network_says_does_not_depend_on_the_exposure():
    torch.manual_seed(0)
    net = LightSplitter()
    torch.nn.init.normal_(net.head.weight, std=0.1)
    linear = undisplay(frames("plain")[0]) * 0.4
    mask = frames("plain")[1]
    A, _ = net(display(linear), mask, GREY)
    net_stops = [net(display(linear * factor), mask, GREY)[0] / factor for factor in (0.5, 2.0)]
    # Only the channel that tells the exposure itself differs.
    assert all(((other - A).abs().mean() / A.mean()) < 0.2 for other in net_stops)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("texture", [0.0, 1.0, 0.4])
def test_losses_and_gradients_are_finite(kind, texture):
    torch.manual_seed(1)
    image, mask = frames(kind)
    net = LightSplitter()
    A_exact, B_exact = undisplay(image) * mask, undisplay(image)
    albedo = torch.full((3, 2, 3, 1, 1), texture)
    losses = [light_loss(net(image, mask, GREY), (A_exact * 0, B_exact * 1e4), albedo, mask)]  # dense fog, mirrored sun
    losses.append(light_loss(net(image, mask, GREY), (A_exact, B_exact), albedo, mask))
    published = PublishedEfe((4, 6, 8))
    x_ren = fuse_published(torch.full_like(image, texture), *published(image * mask))
    losses += [weighted_bce(x_ren, image * mask, mask), weighted_mse(x_ren, image * mask, mask)]
    sum(losses).backward()
    for loss in losses:
        assert loss.isfinite()
    parameters = [*net.parameters(), *published.parameters()]
    assert all(p.grad is not None and p.grad.isfinite().all() for p in parameters)


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


def test_bce_leads_away_from_a_wrong_end():
    x = torch.zeros(1, 3, 4, 4, requires_grad=True)
    weighted_bce(x, torch.ones(1, 3, 4, 4), torch.ones(1, 1, 4, 4)).backward()
    assert (x.grad < 0).all()
    assert x.grad.isfinite().all()


def test_the_tone_is_the_displays_and_never_flat():
    x = torch.linspace(0, 1, 1001, dtype=torch.float64)
    assert torch.allclose(tone(x), display(x))
    bright = torch.tensor([1.0, 2.0, 1e4], dtype=torch.float64, requires_grad=True)
    tone(bright).sum().backward()
    assert (bright.grad > 0.4).all()
    assert torch.autograd.gradcheck(tone, torch.tensor([1e-3, 0.1, 0.9, 3.0], dtype=torch.float64, requires_grad=True))


def test_sizes():
    count = lambda net: sum(p.numel() for p in net.parameters())  # noqa: E731
    assert count(PublishedEfe()) == pytest.approx(34.5e6, rel=2e-3)
    assert count(LightSplitter()) < count(PublishedEfe()) / 40
