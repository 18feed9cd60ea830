from __future__ import annotations

import pytest
import torch

from rauca_core.attack.texture import LIMITS


@pytest.mark.parametrize("name", LIMITS)
def test_start_and_values_agree(name: str) -> None:
    wanted = torch.linspace(0, 1, 11)
    limit = LIMITS[name]
    found = limit.values(limit.start(wanted))
    assert torch.allclose(found, wanted, atol=0.011 if name == "tanh" else 0)


@pytest.mark.parametrize("name", LIMITS)
def test_values_stay_in_range_whatever_adam_does(name: str) -> None:
    limit = LIMITS[name]
    parameter = limit.start(torch.tensor([0.0, 0.5, 1.0])).requires_grad_()
    adam = torch.optim.Adam([parameter], lr=0.7)
    for target in (5.0, -5.0) * 10:
        adam.zero_grad()
        (limit.values(parameter) - target).square().sum().backward()
        assert torch.isfinite(parameter.grad).all()
        adam.step()
        limit.after_step(parameter)
        assert limit.values(parameter).min() >= 0
        assert limit.values(parameter).max() <= 1


@pytest.mark.parametrize(("name", "alive"), [("project", True), ("tanh", True), ("clamp", False)])
def test_texels_pushed_out_of_range_keep_a_gradient(name: str, alive: bool) -> None:
    limit = LIMITS[name]
    parameter = limit.start(torch.tensor([0.9])).requires_grad_()
    adam = torch.optim.Adam([parameter], lr=0.3)
    for _ in range(3):
        adam.zero_grad()
        (-limit.values(parameter)).sum().backward()
        adam.step()
        limit.after_step(parameter)
    adam.zero_grad()
    limit.values(parameter).sum().backward()
    assert bool(parameter.grad.abs() > 0) == alive
