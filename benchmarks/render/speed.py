"""What a step costs: one core, medians, contenders interleaved so that a busy moment hits all of them alike."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import torch

from rauca_core.render import MipmappedTexture, Pyramid, TapCache, Taps, TapSettings

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
    all_taps: dict[str, Sequence[Taps]], texture: MipmappedTexture, repeats: int, moved: Callable[[], None]
) -> dict[str, StepTime]:
    """Forward and backward of a whole ring as one batch, per image, for each contender, taps in memory.

    As in the optimizer, one call serves the batch, and its gradient is added to one buffer of all texels. Building the
    mip levels from the UV map, and handing that gradient down to it, is paid once per step: see `levels_step`.
    """
    times: dict[str, list[StepTime]] = {name: [] for name in all_taps}
    for repeat in range(repeats + 1):
        for name, taps in all_taps.items():
            step = _step(taps, texture)
            if repeat:  # the first round compiles and warms the caches
                times[name].append(step)
            moved()
    return {name: _median(steps) for name, steps in times.items()}


def _step(taps: Sequence[Taps], texture: MipmappedTexture) -> StepTime:
    operators = [view.rows for view in taps]
    started = time.perf_counter()
    pixels = texture.sample(operators)
    forwarded = time.perf_counter()
    asked = torch.ones_like(pixels)
    asking = time.perf_counter()
    torch.autograd.grad(pixels, texture.ticket, asked)
    ended = time.perf_counter()
    scale = 1e3 / len(taps)
    return StepTime(scale * (forwarded - started), scale * (ended - asking))


def _median(steps: Sequence[StepTime]) -> StepTime:
    return StepTime(median(s.forward_ms for s in steps), median(s.backward_ms for s in steps))


def levels_step(pyramid: Pyramid, taps: Taps, repeats: int) -> StepTime:
    """Mip levels from the UV map's texels, and a view's gradient back: once per step, whatever the batch."""
    texels = torch.rand(len(pyramid.texels), 3, requires_grad=True)
    steps = []
    for _ in range(repeats + 1):
        started = time.perf_counter()
        texture = MipmappedTexture(pyramid, texels)
        forwarded = time.perf_counter()
        pixels = texture.sample([taps.rows])
        (ticket,) = torch.autograd.grad(pixels, texture.ticket, torch.ones_like(pixels))
        asking = time.perf_counter()
        torch.autograd.grad(texture.ticket, texels, ticket)
        ended = time.perf_counter()
        steps.append(StepTime(1e3 * (forwarded - started), 1e3 * (ended - asking)))
    return _median(steps[1:])


def streamed_ms(scene: Scene, contender: Contender, repeats: int) -> float:
    """Read a view's taps from the cache on disk, apply them and their transpose: milliseconds per image.

    Nothing is held in memory but the system's own page cache: a step that meets each view once in a long run.
    """
    vehicle, pyramid = scene.car.vehicle, scene.car.pyramid
    texture = scene.car.texture()
    settings = TapSettings(pyramid.size, contender.samples, "box")
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        folder = Path(temporary)

        def step(cache: TapCache) -> None:
            taps = [cache.get(camera) for camera in scene.cameras]
            pixels = texture.sample([view.rows for view in taps])
            torch.autograd.grad(pixels, texture.ticket, torch.ones_like(pixels))

        step(TapCache(folder, vehicle, settings))  # builds them
        # A new cache each time holds nothing in memory; opening it is not part of a step.
        caches = [TapCache(folder, vehicle, settings) for _ in range(min(repeats, 5))]
        return median(elapsed_ms(lambda c=cache: step(c)) for cache in caches) / len(scene.cameras)  # type: ignore[misc]
