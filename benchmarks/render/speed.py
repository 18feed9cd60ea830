"""What a step costs: one core, medians, contenders interleaved so that a busy moment hits all of them alike."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import torch
from torch import Tensor

from rauca_core.render import Pyramid, TapCache, Taps, TapSettings, apply_many

from .contenders import Contender
from .scenes import Scene


@dataclass(frozen=True)
class StepTime:
    """Milliseconds per image."""

    forward_ms: float
    backward_ms: float


def elapsed_ms(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - started)


def resident_steps(
    all_taps: dict[str, Sequence[Taps]], texels: Tensor, repeats: int, moved: Callable[[], None]
) -> dict[str, StepTime]:
    """Forward and backward of a whole ring as one batch, per image, for each contender, taps in memory.

    As in the optimiser, one call serves the batch, and its gradient goes to one buffer of all texels, whose clearing
    is part of the time. Building the mip levels from the UV map is not: it is paid once per step, see `pyramid_step`.
    """
    values = texels.clone().requires_grad_()
    times: dict[str, list[StepTime]] = {name: [] for name in all_taps}
    for repeat in range(repeats + 1):
        for name, taps in all_taps.items():
            step = _step(taps, values)
            if repeat:  # the first round compiles and warms the caches
                times[name].append(step)
            moved()
    return {name: _median(steps) for name, steps in times.items()}


def _step(taps: Sequence[Taps], values: Tensor) -> StepTime:
    operators = [view.rows for view in taps]
    started = time.perf_counter()
    pixels = apply_many(operators, values)
    forwarded = time.perf_counter()
    asked = torch.ones_like(pixels)
    asking = time.perf_counter()
    torch.autograd.grad(pixels, values, asked)
    ended = time.perf_counter()
    scale = 1e3 / len(taps)
    return StepTime(scale * (forwarded - started), scale * (ended - asking))


def _median(steps: Sequence[StepTime]) -> StepTime:
    return StepTime(median(s.forward_ms for s in steps), median(s.backward_ms for s in steps))


def pyramid_step(pyramid: Pyramid, repeats: int) -> StepTime:
    """Mip levels from the UV map's texels, and the gradient back: once per step, whatever the batch."""
    texels = torch.rand(len(pyramid.texels), 3, requires_grad=True)
    steps = []
    for _ in range(repeats + 1):
        started = time.perf_counter()
        levels = pyramid(texels)
        forwarded = time.perf_counter()
        asked = torch.ones_like(levels)
        asking = time.perf_counter()
        torch.autograd.grad(levels, texels, asked)
        ended = time.perf_counter()
        steps.append(StepTime(1e3 * (forwarded - started), 1e3 * (ended - asking)))
    return _median(steps[1:])


def streamed_ms(scene: Scene, contender: Contender, repeats: int) -> float:
    """Read a view's taps from the cache on disk, apply them and their transpose: milliseconds per image.

    Nothing is held in memory but the system's own page cache: a step that meets each view once in a long run.
    """
    vehicle, pyramid = scene.car.vehicle, scene.car.pyramid
    values = scene.car.texels[0].clone().requires_grad_()
    settings = TapSettings(pyramid.size, contender.samples, "box")
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        folder = Path(temporary)

        def step(cache: TapCache) -> None:
            taps = [cache.get(camera) for camera in scene.cameras]
            pixels = apply_many([view.rows for view in taps], values)
            torch.autograd.grad(pixels, values, torch.ones_like(pixels))

        step(TapCache(folder, vehicle, settings))  # builds them
        # A new cache each time holds nothing in memory; opening it is not part of a step.
        caches = [TapCache(folder, vehicle, settings) for _ in range(min(repeats, 5))]
        return median(elapsed_ms(lambda c=cache: step(c)) for cache in caches) / len(scene.cameras)  # type: ignore[misc]
