"""Adam and AdamW are torch's own, bit for bit, and a process that uses them does not load torch's compiler."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest
import torch

from rauca_core.runtime.optimizers import Adam, AdamW

SETTINGS: tuple[dict[str, Any], ...] = ({"fused": True}, {"weight_decay": 0.1}, {"weight_decay": 0.1, "fused": True})
STEP = """
import sys, torch
from rauca_core.runtime.optimizers import Adam, AdamW
for kind in (Adam, AdamW):
    value = torch.ones(3, requires_grad=True)
    optimizer = kind([value])
    optimizer.zero_grad()
    value.sum().backward()
    optimizer.step()
    optimizer.load_state_dict(optimizer.state_dict())
    assert (value < 1).all()
sys.exit("torch._dynamo" in sys.modules)
"""


def trained(kind: type[torch.optim.Optimizer], settings: dict[str, Any]) -> tuple[torch.Tensor, dict[str, Any]]:
    value = torch.linspace(-2, 2, 40, requires_grad=True)
    optimizer = kind([value], lr=0.03, **settings)
    for step in range(12):
        if step == 6:
            state = optimizer.state_dict()
            optimizer = kind([value], lr=0.5, **settings)
            optimizer.load_state_dict(state)
        optimizer.zero_grad()
        (value - 1).pow(4).sum().backward()
        optimizer.step()
    return value.detach(), optimizer.state_dict()


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
@pytest.mark.parametrize(("ours", "torchs"), [(Adam, torch.optim.Adam), (AdamW, torch.optim.AdamW)])
def test_they_are_torchs_own(
    ours: type[torch.optim.Optimizer], torchs: type[torch.optim.Optimizer], settings: dict[str, Any]
) -> None:
    (value, state), (reference, its_state) = trained(ours, settings), trained(torchs, settings)
    assert torch.equal(value, reference)
    assert state["param_groups"] == its_state["param_groups"]
    for name, tensor in state["state"][0].items():
        assert torch.equal(tensor, its_state["state"][0][name])


def test_a_process_that_steps_does_not_load_the_compiler() -> None:
    assert subprocess.run([sys.executable, "-c", STEP], check=False).returncode == 0
