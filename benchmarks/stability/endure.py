"""Taking many steps on a hard case, and what was seen on the way."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from rauca_core.attack import DetectorEnsemble, make_settings
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset, Vehicle
from rauca_core.runtime.cpu import threads

from .cases import SIZE, HardCase
from .detectors import Answering
from .drawn import make_dataset

STEPS = 500
AZIMUTHS = (40.0, 250.0)
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
        first_loss, last_loss: Eq. 8, means over a tenth of the steps at either end.
        largest_gradient: of a texel, over all steps.
    """

    steps: int
    finite: bool
    in_range: bool
    learnt: float
    moved: float
    stray: int
    first_loss: float
    last_loss: float
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
    ever, losses, largest, finite = torch.zeros(len(begin), dtype=torch.bool), [], 0.0, True
    for _ in range(steps):
        report = run.advance()
        gradient, texels = run.texture.parameter.grad, run.texture.texels().detach()
        assert gradient is not None
        told = torch.tensor([report.loss, report.attack, report.smooth, report.score])
        finite &= all(bool(torch.isfinite(t).all()) for t in (told, gradient, texels))
        if len(gradient) == len(begin):
            ever |= (gradient != 0).any(1)
        largest = max(largest, float(gradient.abs().max()))
        losses.append(report.loss)
    moved = (texels != begin).any(1)
    tenth = max(steps // 10, 1)
    return Endured(
        steps,
        finite,
        bool((texels >= 0).all() and (texels <= 1).all()),
        float(ever.float().mean()),
        float(moved.float().mean()),
        int((moved & ~ever).sum()),
        sum(losses[:tenth]) / tenth,
        sum(losses[-tenth:]) / tenth,
        largest,
    )
