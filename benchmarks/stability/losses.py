"""Predictions that make a loss or its gradient infinite: the precision is that of the detector's answer.

Losses are taken in float32 where the detector answers in bfloat16, as in the optimizer.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from rauca_core.attack import SmoothLoss, attack_loss, box_overlap, detection_score
from rauca_core.attack.losses import OBJECTIVES, Predicted
from rauca_core.detect import DensePredictions

from .checks import Check, Try, expect

TEN = (0.0, 0.0, 10.0, 10.0)
INF = math.inf


def _wide(dtype: torch.dtype) -> torch.dtype:
    return torch.float64 if dtype == torch.float64 else torch.float32


def _predictions(boxes: Tensor, sure: Tensor) -> DensePredictions:
    """One class, whose probability and objectness are ``sure`` (B, N), as the optimizer's panel takes them."""
    return DensePredictions(boxes, sure, sure[..., None]).to(_wide(boxes.dtype))


def _nothing_to_hide(boxes: list[list[float]], truth: tuple[float, ...]) -> Try:
    def attempt(dtype: torch.dtype) -> str:
        leaf = torch.tensor(boxes, dtype=dtype).reshape(1, -1, 4).requires_grad_()
        score = detection_score(
            _predictions(leaf, leaf.new_ones(leaf.shape[:2])), torch.tensor([truth], dtype=_wide(dtype)), 0
        )
        loss = attack_loss(score)
        expect(loss.tolist() == [0.0], f"loss {loss.tolist()}")
        if not loss.requires_grad:
            return "loss 0, no gradient"
        loss.sum().backward()
        expect(leaf.grad is not None and torch.isfinite(leaf.grad).all(), "the gradient is not finite")
        return "loss 0, gradient finite"

    return attempt


def _certain(dtype: torch.dtype) -> str:
    boxes = torch.tensor([[TEN]], dtype=dtype)
    sure = torch.ones(1, 1, dtype=dtype, requires_grad=True)
    loss = attack_loss(detection_score(_predictions(boxes, sure), boxes[:, 0].to(_wide(dtype)), 0))
    loss.sum().backward()
    assert sure.grad is not None
    slope = float(sure.grad)
    expect(bool(torch.isfinite(loss).all()), "the loss is not finite")
    expect(1.0 < slope < 1e8, f"slope {slope:.2g}")
    return f"loss {float(loss.detach()):.1f}, slope {slope:.2g}"


def _all_objectives(boxes: list[list[float]]) -> Try:
    def attempt(dtype: torch.dtype) -> str:
        truth = torch.tensor([TEN], dtype=_wide(dtype))
        for sure in (0.0, 1.0):
            for name, objective in OBJECTIVES.items():
                leaves = [torch.tensor([boxes], dtype=dtype), torch.full((1, len(boxes)), sure, dtype=dtype)]
                leaves += [torch.zeros(1, 2, 3, 3, dtype=dtype)]  # an attention layer that is dead
                found, features = _predictions(*(x.requires_grad_() for x in leaves[:2])), leaves[2].requires_grad_()
                loss = objective(Predicted(found, truth, 0, detection_score(found, truth, 0), features)).sum()
                loss.backward()
                expect(torch.isfinite(loss), f"{name} at {sure:g}: loss {float(loss.detach())}")
                fine = all(x.grad is None or torch.isfinite(x.grad).all() for x in leaves)
                expect(fine, f"{name} at {sure:g}: the gradient is not finite")
        return f"all {len(OBJECTIVES)} objectives finite"

    return attempt


def _without_end(dtype: torch.dtype) -> str:
    rows = [[-INF, -INF, INF, INF], [0, 0, 9, INF], [0, 0, 9, 10], [1e30, 0, 1e38, 9]]
    boxes = torch.tensor([rows], dtype=dtype, requires_grad=True)
    overlap = box_overlap(boxes.to(_wide(dtype)), torch.tensor([TEN], dtype=_wide(dtype)))
    overlap.sum().backward()
    assert boxes.grad is not None
    off = float((overlap.detach().double() - torch.tensor([0.0, 0.0, 0.9, 0.0], dtype=torch.float64)).abs().max())
    expect(off < 1e-2, f"overlaps {overlap.tolist()}")
    expect(torch.isfinite(boxes.grad).all(), "the gradient is not finite")
    expect(boxes.grad[0, 2].abs().sum() > 0, "the sound box has no gradient")
    return "overlap 0, beside a sound box's 0.9; gradients finite"


def _log_at_one(dtype: torch.dtype) -> str:
    leaf = torch.tensor([0.0, 0.5, 0.999999, 1.0], dtype=dtype, requires_grad=True)
    loss = attack_loss(leaf.to(_wide(dtype)))
    loss.sum().backward()
    assert leaf.grad is not None
    expect(torch.isfinite(loss).all() and torch.isfinite(leaf.grad).all(), f"loss {loss.tolist()}")
    expect((leaf.grad > 0).all(), "no slope")
    return f"loss {float(loss.detach()[-1]):.1f}, slope {float(leaf.grad[-1]):.2g}"


def _flat_map(dtype: torch.dtype) -> str:
    smooth = SmoothLoss(torch.arange(144).numpy(), 12)
    for value in (0.0, 0.3, 1.0):
        texels = torch.full((144, 3), value, dtype=_wide(dtype), requires_grad=True)
        loss = smooth(texels)
        loss.backward()
        assert texels.grad is not None
        expect(float(loss.detach()) == 0.0, f"loss {float(loss.detach())}")
        expect(not texels.grad.any(), "a gradient")
    return "loss and gradient exactly 0"


def _check(name: str, expected: str, attempt: Try) -> Check:
    return Check("losses", name, expected, attempt)


NOTHING = "loss 0, gradient finite"
FINITE = "every objective and its gradient finite"
CHECKS = (
    _check("no predictions", NOTHING, _nothing_to_hide([], TEN)),
    _check("no overlap", NOTHING, _nothing_to_hide([[20, 20, 30, 30]], TEN)),
    _check("true box without area", NOTHING, _nothing_to_hide([[0, 0, 5, 5]], (5, 5, 5, 5))),
    _check("box inside out", NOTHING, _nothing_to_hide([[5, 5, 0, 0]], TEN)),
    _check("both boxes points", NOTHING, _nothing_to_hide([[3, 3, 3, 3]], (3, 3, 3, 3))),
    _check("certain detection", "finite, with a slope", _certain),
    _check("-log(1 - x) at 1", "finite, with a slope", _log_at_one),
    _check("boxes without end", "overlap nothing, finite gradients", _without_end),
    _check("objectives: exact box", FINITE, _all_objectives([list(TEN)])),
    _check("objectives: endless box", FINITE, _all_objectives([[-INF, -INF, INF, INF], list(TEN)])),
    _check("objectives: box without area", FINITE, _all_objectives([[3, 3, 3, 3]])),
    Check(
        "losses", "smoothness of a flat map", "loss and gradient exactly 0", _flat_map,
        {torch.bfloat16: "the UV map is never bfloat16"},
    ),
)  # fmt: skip
