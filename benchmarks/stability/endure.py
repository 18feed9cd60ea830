"""The optimizer's hard cases through the real loop: many steps, what was seen on the way, and what it must be.

The precision is that of the detectors, or of the whole loop for float64.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch

from rauca_core.attack import DetectorEnsemble, make_settings
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset, Vehicle
from rauca_core.runtime.cpu import threads

from .cases import CASES, SIZE, HardCase
from .checks import Check, expect
from .detectors import Answering
from .drawn import make_dataset, painted_box

STEPS = 500
AZIMUTHS = (40.0, 250.0)
LEARNING = 0.05  # share of the texels that have a gradient where the attack has one
SMALL = {"batch": 2, "map_size": 32, "samples": 2, "lr": 0.02, "beta": 0.0}


@dataclass(frozen=True)
class Endured:
    """What became of a run.

    Attributes:
        steps: taken.
        finite: loss, attack, smoothness, gradient and UV map were, after every step.
        in_range: texels stayed in [0, 1].
        learnt: texels that had a gradient at some step, share of all.
        moved: texels that are not where they began, share of all.
        stray: texels that moved without ever having had a gradient.
        largest_gradient: of a texel, over all steps.
    """

    steps: int
    finite: bool
    in_range: bool
    learnt: float
    moved: float
    stray: int
    largest_gradient: float


def endure(
    case: HardCase, vehicle: Vehicle, folder: Path, steps: int = STEPS, double: bool = False, **chosen: Any
) -> Endured:
    """Optimize on a case by the real loop: files, taps, light, augmentation, detector, Adam.

    Args:
        folder: for its data set; made where it is not there.
        double: begin with a texture of float64, whose precision all that follows takes on.
        chosen: settings of the optimizer, before those of the case.
    """
    settings = make_settings(**{**SMALL, **chosen, **case.settings, "steps": steps})
    made = (folder / "dataset.json").is_file()
    dataset = Dataset(folder) if made else make_dataset(folder, vehicle, SIZE, AZIMUTHS, look=case.look)
    ensemble = DetectorEnsemble([Answering(case.answer)], settings.target, None, settings.precision, settings.objective)
    run = Run(dataset, ensemble, settings)
    if double:
        run.texture.parameter = run.texture.parameter.detach().double().requires_grad_()
        run.adam = torch.optim.Adam([run.texture.parameter], lr=settings.lr, fused=True)
    try:
        with threads(1):
            return _watch(run, steps)
    finally:
        run.close()


def _watch(run: Run, steps: int) -> Endured:
    begin = run.texture.texels().detach().clone()
    ever, largest, finite = torch.zeros(len(begin), dtype=torch.bool), 0.0, True
    for _ in range(steps):
        report = run.advance()
        gradient, texels = run.texture.parameter.grad, run.texture.texels().detach()
        assert gradient is not None
        told = torch.tensor([report.loss, report.attack, report.smooth, report.score])
        finite &= all(bool(torch.isfinite(t).all()) for t in (told, gradient, texels))
        if len(gradient) == len(begin):
            ever |= (gradient != 0).any(1)
        largest = max(largest, float(gradient.abs().max()))
    moved = (texels != begin).any(1)
    return Endured(
        steps,
        finite,
        bool((texels >= 0).all() and (texels <= 1).all()),
        float(ever.float().mean()),
        float(moved.float().mean()),
        int((moved & ~ever).sum()),
        largest,
    )


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
