"""The optimizer's hard cases as checks: the precision is that of the detectors, or of the whole loop for float64."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from .box import painted_box
from .cases import CASES, HardCase
from .checks import Check, expect
from .endure import Endured, endure

LEARNING = 0.05  # share of the texels that have a gradient where the attack has one


def judge(case: HardCase, found: Endured) -> str:
    """What became of a run, in words.

    Raises:
        UnexpectedError: something was not finite, or paint moved otherwise than by its gradient.
    """
    expect(found.finite, f"not finite within {found.steps} steps")
    expect(found.in_range, "texels outside [0, 1]")
    expect(found.stray == 0, f"{found.stray} texels moved without a gradient")
    expect(found.moved == found.learnt, f"{found.learnt:.1%} of the texels had a gradient, {found.moved:.1%} moved")
    expect((found.learnt > LEARNING) == case.learns, f"{found.learnt:.1%} of the texels had a gradient")
    if not found.learnt:
        return "finite, no paint moves"
    return f"finite, {found.moved:.0%} of the paint moves, gradients up to {found.largest_gradient:.0e}"


def checks(steps: int) -> tuple[Check, ...]:
    """All cases, each over ``steps`` steps."""
    moves = {True: "finite, paint moves", False: "finite, no paint moves"}
    return tuple(
        Check("optimizer", f"{case.name}: {case.about}", moves[case.learns], partial(_attempt, case, steps))
        for case in CASES
    )


def _attempt(case: HardCase, steps: int, dtype: torch.dtype) -> str:
    precision = "bfloat16" if dtype == torch.bfloat16 else "float32"
    with TemporaryDirectory() as folder:
        box, double = painted_box(), dtype == torch.float64
        return judge(case, endure(case, box, Path(folder) / "data", steps, double, precision=precision))
