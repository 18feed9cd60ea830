"""How much sooner a step is done than with Algorithm 2: from the UV map to one view's pixels, and the gradient back."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

import torch

from rauca_core.render import MipmappedTexture

from .contenders import Contender
from .published import UvTraversalStep
from .scenes import Scene


@dataclass(frozen=True)
class Speedup:
    """Milliseconds per step of one image, medians; one core, contenders in turn.

    Attributes:
        algorithm2_forward_ms, algorithm2_backward_ms: map to tensor to pixels, and back.
        ours_forward_ms, ours_backward_ms: mip levels to pixels, and back.
        levels_forward_ms, levels_backward_ms: UV map to mip levels, and back, which clears the gradient's buffer
            for the next step: once per step for any batch.
    """

    algorithm2_forward_ms: float
    algorithm2_backward_ms: float
    ours_forward_ms: float
    ours_backward_ms: float
    levels_forward_ms: float
    levels_backward_ms: float

    @property
    def algorithm2_ms(self) -> float:
        return self.algorithm2_forward_ms + self.algorithm2_backward_ms

    @property
    def operator(self) -> float:
        """Without our mip levels: what each image of a large batch gains."""
        return self.algorithm2_ms / (self.ours_forward_ms + self.ours_backward_ms)

    @property
    def whole_step(self) -> float:
        """With our mip levels, in a step of a single image."""
        levels = self.levels_forward_ms + self.levels_backward_ms
        return self.algorithm2_ms / (self.ours_forward_ms + self.ours_backward_ms + levels)

    def to_json(self) -> dict[str, Any]:
        return {**asdict(self), "operator": self.operator, "whole_step": self.whole_step}


def measure_speedup(scene: Scene, ours: Contender, repeats: int) -> Speedup:
    """Time both on the scene's median view by paint shown."""
    shown = [int((reference.coverage > 0).sum()) for reference in scene.references]
    camera = scene.cameras[sorted(range(len(shown)), key=shown.__getitem__)[len(shown) // 2]]
    pyramid, uv_map = scene.car.pyramid, scene.car.maps[0]
    published = UvTraversalStep(scene.car, camera)
    taps = ours.taps(scene.car.vehicle, camera, pyramid)
    texels = pyramid.from_map(torch.from_numpy(uv_map).permute(2, 0, 1)).requires_grad_()
    times = []
    for _ in range(repeats + 1):
        clock = _Clock()
        colors, kept = published.forward(uv_map)
        clock.lap()
        published.backward(torch.ones_like(colors), colors, kept)
        clock.lap()
        del colors, kept
        for _ in range(4):  # ours is short: the last of a few, its caches as warm as in a run
            clock.restart()
            texture = MipmappedTexture(pyramid, texels)
            clock.lap()
            pixels = texture.sample([taps.rows])
            clock.lap()
            asked = torch.ones_like(pixels)
            clock.restart()
            (ticket,) = torch.autograd.grad(pixels, texture.ticket, asked)
            clock.lap()
            torch.autograd.grad(texture.ticket, texels, ticket)
            clock.lap()
        times.append(clock.laps[:2] + clock.laps[-4:])
    a2_forward, a2_backward, up, forward, backward, down = (median(t) for t in zip(*times[1:], strict=True))
    return Speedup(a2_forward, a2_backward, forward, backward, up, down)


class _Clock:
    """Laps in milliseconds."""

    def __init__(self) -> None:
        self.laps: list[float] = []
        self.restart()

    def restart(self) -> None:
        self._started = time.perf_counter()

    def lap(self) -> None:
        now = time.perf_counter()
        self.laps.append(1e3 * (now - self._started))
        self._started = time.perf_counter()
