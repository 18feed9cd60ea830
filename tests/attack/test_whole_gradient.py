"""Eq. 8 differentiated from the detector's loss back to what is painted, against finite differences.

Through the run's own stages, in double precision: what Adam is given is the gradient of what the run reports.
"""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from rauca_core.attack import DetectorEnsemble, make_settings
from rauca_core.attack import losses as objectives
from rauca_core.attack.frames import boxes_of
from rauca_core.attack.history import Stopwatch
from rauca_core.attack.methods import METHODS, settings_of
from rauca_core.attack.run import Run
from rauca_core.contract import Dataset

REACH = 1e-7  # short: absolute differences of neighbors have kinks
STILL = 1e-15  # a learning rate that leaves the paint where it is
SMALL: dict[str, Any] = {"batch": 2, "map_size": 32, "samples": 2, "memory_mb": 64, "start": "plain"}
# Attention's weights of channels are constants of it, as published, and so is complete IoU's weight of the aspect:
# neither has a true gradient. Against references of their own they are held in test_losses.py and test_published.py.
CHOSEN = {
    **{name: settings_of(name, **SMALL) for name in METHODS if name not in ("das", "fca")},
    "fca, for its facets and its start": settings_of("fca", objective="confidence", **SMALL),
    "rauca-final as published, Eq. 6 and exact light": settings_of(
        "rauca-final", "published", objective="eq6", light="exact", **SMALL
    ),
    "tanh, two detectors": {**SMALL, "limit": "tanh", "weights": (2.0, 1.0)},
    "another detector's size": {**SMALL, "detector_size": 96},
}


def in_double(run: Run) -> Tensor:
    """The run's parameter, double and away from the ends; Adam only takes the gradient."""
    generator = torch.Generator().manual_seed(0)
    parameter = run.texture.parameter.detach().double()
    parameter += (torch.rand(parameter.shape, generator=generator, dtype=torch.float64) - 0.5) * 0.4
    run.texture.parameter = parameter.requires_grad_()
    run.adam = torch.optim.Adam([parameter], lr=STILL)
    return parameter


@pytest.mark.parametrize("name", CHOSEN)
def test_adam_is_given_the_gradient_of_the_total_loss(
    dataset: Dataset, small_detector: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(objectives, "CLOSE", 0.02)  # the small detector's boxes are small too
    settings = make_settings(**{**CHOSEN[name], "beta": 1.0, "lr": STILL})
    detectors = [small_detector] * (len(settings.weights) if settings.weights else 1)
    run = Run(dataset, DetectorEnsemble(detectors, "car", settings.weights, objective=settings.objective), settings)
    parameter, batch = in_double(run), [run.store.ready(0), run.store.ready(4)]

    def total() -> Tensor:
        images = run._render(batch, Stopwatch())
        found = run.ensemble.attack(*run._augment(images, boxes_of(batch)))
        smooth, extra = run._descend(images, run._augment(images, boxes_of(batch))[0], found, batch, Stopwatch())
        return settings.alpha * found.losses.mean() + settings.beta * smooth.mean() + settings.gamma * extra

    try:
        total()
        assert parameter.grad is not None
        gradient = parameter.grad.clone()
        generator = torch.Generator().manual_seed(1)
        for direction in (gradient / gradient.norm(), torch.randn(gradient.shape, generator=generator).double()):
            step = REACH * direction
            with torch.no_grad():
                parameter += step
            above = total()
            with torch.no_grad():
                parameter -= 2 * step
            below = total()
            with torch.no_grad():
                parameter += step
            assert float(above - below) / (2 * REACH) == pytest.approx(
                float((gradient * direction).sum()), rel=1e-4, abs=1e-8
            )
    finally:
        run.close()
