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

from . import Checks, expect, wide

TEN = (0.0, 0.0, 10.0, 10.0)
INF = math.inf
NEVER_HALF = {torch.bfloat16: "the UV map is never bfloat16"}
CHECKS = Checks("losses")


def _predictions(boxes: Tensor, sure: Tensor) -> DensePredictions:
    """One class, whose probability and objectness are ``sure`` (B, N), as the optimizer's panel takes them."""
    return DensePredictions(boxes, sure, sure[..., None]).to(wide(boxes.dtype))


def _nothing_to_hide(dtype: torch.dtype, boxes: list[list[float]], truth: tuple[float, ...] = TEN) -> str:
    leaf = torch.tensor(boxes, dtype=dtype).reshape(1, -1, 4).requires_grad_()
    score = detection_score(
        _predictions(leaf, leaf.new_ones(leaf.shape[:2])), torch.tensor([truth], dtype=wide(dtype)), 0
    )
    loss = attack_loss(score)
    expect(loss.tolist() == [0.0], f"loss {loss.tolist()}")
    if not loss.requires_grad:
        return "loss 0, no gradient"
    loss.sum().backward()
    expect(leaf.grad is not None and torch.isfinite(leaf.grad).all(), "the gradient is not finite")
    return "loss 0, gradient finite"


for name, found, truth in (
    ("no predictions", [], TEN),
    ("no overlap", [[20, 20, 30, 30]], TEN),
    ("true box without area", [[0, 0, 5, 5]], (5, 5, 5, 5)),
    ("box inside out", [[5, 5, 0, 0]], TEN),
    ("both boxes points", [[3, 3, 3, 3]], (3, 3, 3, 3)),
):
    CHECKS.case(name, "loss 0, gradient finite", boxes=found, truth=truth)(_nothing_to_hide)


@CHECKS.case("certain detection", "finite, with a slope")
def _certain(dtype: torch.dtype) -> str:
    boxes = torch.tensor([[TEN]], dtype=dtype)
    sure = torch.ones(1, 1, dtype=dtype, requires_grad=True)
    loss = attack_loss(detection_score(_predictions(boxes, sure), boxes[:, 0].to(wide(dtype)), 0))
    (gradient,) = torch.autograd.grad(loss.sum(), sure)
    slope = float(gradient)
    expect(bool(torch.isfinite(loss).all()), "the loss is not finite")
    expect(1.0 < slope < 1e8, f"slope {slope:.2g}")
    return f"loss {float(loss.detach()):.1f}, slope {slope:.2g}"


def _all_objectives(dtype: torch.dtype, boxes: list[list[float]]) -> None:
    truth = torch.tensor([TEN], dtype=wide(dtype))
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


for name, boxes in (
    ("exact box", [list(TEN)]),
    ("endless box", [[-INF, -INF, INF, INF], list(TEN)]),
    ("box without area", [[3, 3, 3, 3]]),
):
    CHECKS.case(f"objectives: {name}", "every objective and its gradient finite", boxes=boxes)(_all_objectives)


@CHECKS.case("boxes without end", "overlap nothing, finite gradients")
def _without_end(dtype: torch.dtype) -> None:
    rows = [[-INF, -INF, INF, INF], [0, 0, 9, INF], [0, 0, 9, 10], [1e30, 0, 1e38, 9]]
    boxes = torch.tensor([rows], dtype=dtype, requires_grad=True)
    overlap = box_overlap(boxes.to(wide(dtype)), torch.tensor([TEN], dtype=wide(dtype)))
    (gradient,) = torch.autograd.grad(overlap.sum(), boxes)
    off = float((overlap.detach().double() - torch.tensor([0.0, 0.0, 0.9, 0.0], dtype=torch.float64)).abs().max())
    expect(off < 1e-2, f"overlaps {overlap.tolist()}")
    expect(torch.isfinite(gradient).all(), "the gradient is not finite")
    expect(gradient[0, 2].abs().sum() > 0, "the sound box has no gradient")


@CHECKS.case("-log(1 - x) at 1", "finite, with a slope")
def _log_at_one(dtype: torch.dtype) -> str:
    leaf = torch.tensor([0.0, 0.5, 0.999999, 1.0], dtype=dtype, requires_grad=True)
    loss = attack_loss(leaf.to(wide(dtype)))
    (gradient,) = torch.autograd.grad(loss.sum(), leaf)
    expect(torch.isfinite(loss).all() and torch.isfinite(gradient).all(), f"loss {loss.tolist()}")
    expect((gradient > 0).all(), "no slope")
    return f"loss {float(loss.detach()[-1]):.1f}, slope {float(gradient[-1]):.2g}"


@CHECKS.case("smoothness of a flat map", "loss and gradient exactly 0", NEVER_HALF)
def _flat_map(dtype: torch.dtype) -> None:
    smooth = SmoothLoss(torch.arange(144).numpy(), 12)
    for value in (0.0, 0.3, 1.0):
        texels = torch.full((144, 3), value, dtype=wide(dtype), requires_grad=True)
        loss = smooth(texels)
        (gradient,) = torch.autograd.grad(loss, texels)
        expect(float(loss.detach()) == 0.0, f"loss {float(loss.detach())}")
        expect(not gradient.any(), "a gradient")
