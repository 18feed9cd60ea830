"""The mipmapped texture of a step: the same numbers as levels and views one by one, and a buffer always left clear."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from rauca_core.contract import Camera, Vehicle
from rauca_core.render import MipmappedTexture, Pyramid, Taps, apply_many, build_taps

MAP = 64


@pytest.fixture
def pyramid(box_vehicle: Vehicle) -> Pyramid:
    return Pyramid.of(box_vehicle, MAP)


@pytest.fixture
def views(box_vehicle: Vehicle, pyramid: Pyramid) -> list[Taps]:
    eyes = np.array([[5.0, 3.5, 2.0], [-6.0, 2.0, 1.0]])
    cameras = [Camera.look_at(eye, np.array([0.0, 0.0, 0.7]), 50, 48, 40) for eye in eyes]
    return [build_taps(box_vehicle, camera, MAP, 2, pyramid=pyramid) for camera in cameras]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64, torch.float16])
def test_sees_and_learns_what_levels_and_operators_do(pyramid: Pyramid, views: list[Taps], dtype: torch.dtype) -> None:
    operators = [view.rows for view in views]
    start = torch.rand(len(pyramid.texels), 3, generator=torch.Generator().manual_seed(0)).to(dtype)
    texels, others = start.clone().requires_grad_(), start.clone().requires_grad_()
    seen, wanted = MipmappedTexture(pyramid, texels).sample(operators), apply_many(operators, pyramid(others))
    assert torch.equal(seen, wanted)
    asked = torch.rand_like(seen)
    seen.backward(asked)
    wanted.backward(asked)
    assert texels.grad.dtype == dtype
    assert torch.equal(texels.grad, others.grad)


@pytest.mark.parametrize("textures", [1, 2])
def test_views_share_one_gradient_and_leave_it_clear(pyramid: Pyramid, views: list[Taps], textures: int) -> None:
    texels = torch.rand(len(pyramid.texels), 3, requires_grad=True)
    in_work = [MipmappedTexture(pyramid, texels) for _ in range(textures)]
    one, two = in_work[0].sample([views[0].rows]), in_work[-1].sample([views[1].rows])
    (both,) = torch.autograd.grad(one.square().sum() + two.sum(), texels, retain_graph=True)
    kept = both.clone()
    assert not next(iter(pyramid.spare.values())).any()
    (first,) = torch.autograd.grad(one.square().sum(), texels, retain_graph=True)
    (second,) = torch.autograd.grad(two.sum(), texels)
    assert torch.allclose(first + second, both, atol=1e-5)
    assert torch.equal(both, kept)  # what was handed out stays the caller's


def test_an_unused_texture_has_no_gradient(pyramid: Pyramid) -> None:
    texels = torch.rand(len(pyramid.texels), 3, requires_grad=True)
    pixels = MipmappedTexture(pyramid, texels).sample([])
    assert pixels.shape == (0, 3)
    pixels.sum().backward()
    assert not texels.grad.any()
    assert not MipmappedTexture(pyramid, texels.detach()).sample([]).requires_grad
