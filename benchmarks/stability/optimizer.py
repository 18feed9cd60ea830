"""What makes a loss or a gradient infinite, in frames or in what a detector answers: steps of the real loop on each.

The precision is that of the detectors, or of the whole loop for float64.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch

from rauca_core.attack import DetectorEnsemble, make_settings
from rauca_core.attack.run import Run
from rauca_core.contract import Camera, Dataset, Vehicle
from rauca_core.runtime.devices import threads

from . import Check, detectors, expect
from .drawn import CENTER, Look, Maps, around, make_dataset, painted_box

SIZE = 48  # pixels
LARGEST_HALF, SMALLEST_HALF = 65504.0, 6e-8  # of float16, as light maps are stored
MIDDLE = (0.25, 0.25, 0.75, 0.75)
AZIMUTHS = (40.0, 250.0)
LEARNING = 0.05  # share of the texels that have a gradient where the attack has one
SMALL = {"batch": 2, "map_size": 32, "samples": 2, "lr": 0.02, "beta": 0.0}


@dataclass(frozen=True)
class HardCase:
    """How the frames look, what the detector answers, and whether the attack then has a gradient on the UV map."""

    name: str
    about: str
    look: Look = field(default_factory=Look)
    answer: detectors.Answer = detectors.as_found
    learns: bool = True
    settings: Mapping[str, Any] = field(default_factory=dict)  # of the optimizer, where they differ


def _from_afar(azimuth_deg: float, size: int) -> Camera:
    """The vehicle is about a pixel, and aimed half a pixel aside: onto one, not between four."""
    azimuth, distance_m = np.radians(azimuth_deg), 260.0
    eye = distance_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.1])
    half = distance_m / around(0.0, size).K[0, 0] / 2
    ahead = Camera.look_at(eye, np.array(CENTER), 45, size, size)
    return Camera.look_at(eye, np.array(CENTER) + half * (ahead.R[0] + ahead.R[1]), 45, size, size)


def _turned_away(azimuth_deg: float, size: int) -> Camera:
    eye = around(azimuth_deg, size).position
    return Camera.look_at(eye, 2 * eye - np.array(CENTER), 45, size, size)


def _cut_off(azimuth_deg: float, size: int) -> Camera:
    """The vehicle reaches into a corner of the picture by a few pixels."""
    ordinary = around(azimuth_deg, size)
    aside = ordinary.position + 9.0 * ordinary.R[2] + 4.5 * ordinary.R[0] + 3.2 * ordinary.R[1]
    return Camera.look_at(ordinary.position, aside, 45, size, size)


def _flat(A: float, B: float) -> Any:
    """Light of one strength on all paint, and behind it."""

    def light(paint: Maps, rest: Maps) -> tuple[Maps, Maps]:
        return np.where(paint > 0, np.float32(A), np.float32(0)), np.full_like(rest, B)

    return light


def _below_zero(A: Maps, B: Maps) -> tuple[Maps, Maps]:
    return A - np.float32(0.4), B


_AT = (SIZE / 4, SIZE / 4, SIZE * 3 / 4, SIZE * 3 / 4)  # the same in pixels
_STILL: Mapping[str, Any] = {"roa": False}  # the box stays where the detector has it

CASES = (
    HardCase("ordinary", "nothing hard, to compare with"),
    HardCase("empty mask", "no paint in the picture", Look(_turned_away, box=MIDDLE), learns=False),
    HardCase("one pixel", "the vehicle is a pixel", Look(_from_afar)),
    HardCase("cut off", "the augmentation moves the vehicle out of the picture", Look(_cut_off)),
    HardCase("no box area", "the true box is a point", Look(box=(0.5, 0.5, 0.5, 0.5)), learns=False),
    HardCase("black night", "A = B = 0", Look(light=_flat(0, 0)), learns=False),
    HardCase("fog", "A = 0: the paint cannot be seen", Look(light=_flat(0, 0.7)), learns=False),
    HardCase("blinding", "A and B at float16's largest", Look(light=_flat(LARGEST_HALF, LARGEST_HALF)), learns=False),
    HardCase("faint", "A at float16's smallest, B = 0", Look(light=_flat(SMALLEST_HALF, 0))),
    HardCase("negative light", "A below 0 in parts, from noise", Look(light=_below_zero)),
    HardCase("no boxes", "the detector returns none", answer=detectors.nothing, learns=False),
    HardCase("no detection", "every probability is exactly 0", answer=detectors.unseen, learns=False),
    HardCase("no overlap", "every box misses the vehicle", answer=detectors.elsewhere, learns=False),
    HardCase(
        "certain", "confidence and overlap exactly 1, no slope",
        Look(box=MIDDLE), partial(detectors.saturated, _AT), False, _STILL,
    ),
    HardCase(
        "certain, steep", "confidence and overlap exactly 1, and a slope",
        Look(box=MIDDLE), partial(detectors.sure, _AT), True, _STILL,
    ),
    HardCase("endless boxes", "boxes from minus to plus infinity", answer=detectors.endless),
    HardCase("inside out", "right edges left of left ones", answer=detectors.inside_out, learns=False),
    HardCase("points", "predicted boxes without area", answer=detectors.points, learns=False),
)  # fmt: skip


@dataclass(frozen=True)
class Endured:
    """What became of a run."""

    steps: int
    finite: bool  # loss, attack, smoothness, gradient and UV map, after every step
    in_range: bool  # texels stayed in [0, 1]
    learnt: float  # share of the texels that had a gradient at some step
    moved: float  # share that are not where they began
    stray: int  # texels that moved without ever having had a gradient
    largest_gradient: float  # of a texel, over all steps


def endure(case: HardCase, vehicle: Vehicle, folder: Path, steps: int, double: bool = False, **chosen: Any) -> Endured:
    """Optimize on a case by the real loop, on the data set in ``folder``, which is made where it is not there.

    ``double`` begins with a texture of float64, whose precision all that follows takes on.
    """
    settings = make_settings(**{**SMALL, **chosen, **case.settings, "steps": steps})
    made = (folder / "dataset.json").is_file()
    dataset = Dataset(folder) if made else make_dataset(folder, vehicle, SIZE, AZIMUTHS, look=case.look)
    ensemble = DetectorEnsemble(
        [detectors.Answering(case.answer)], settings.target, None, settings.precision, settings.objective
    )
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
    """What became of a run, in words; raises UnexpectedError where paint moved otherwise than by its gradient."""
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
