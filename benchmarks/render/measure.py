"""One scene, everything that is measured on it: an entry per renderer and texture."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import mean

import numpy as np

from rauca_core.render import Taps

from .accuracy import ring_psnr_db
from .contenders import Contender
from .coverage import reached_texels, visible_texels
from .scenes import Car, Scene
from .settings import Settings
from .speed import StepTime, resident_steps
from .textures import TEXTURES
from .views import ring


@dataclass(frozen=True)
class Entry:
    """One renderer with one texture on one ring.

    Attributes:
        psnr_db: against the reference, over the pixels that show paint.
        forward_ms, backward_ms: per image, taps in memory, the ring as one batch, one core; mip levels not included.
        build_ms: to make one view's taps.
        taps_per_pixel: of pixels that show paint, mean over the ring.
        texels_touched: texels of the UV map that receive gradient from the ring.
        reached: share in [0, 1] of the ring's visible paintable texels among them.
    """

    name: str
    vehicle: str
    ring: str
    size: int
    texture: str
    samples: int
    psnr_db: float
    forward_ms: float
    backward_ms: float
    build_ms: float
    taps_per_pixel: float
    texels_touched: int
    reached: float

    @property
    def step_ms(self) -> float:
        return self.forward_ms + self.backward_ms


def measure_scene(
    scene: Scene, contenders: list[Contender], settings: Settings, moved: Callable[[], None]
) -> list[Entry]:
    """Measure every contender; ``moved`` is called once per contender built and once per contender and timing round."""
    taps: dict[str, Sequence[Taps]] = {}
    build: dict[str, float] = {}
    for contender in contenders:
        views, times = [], []
        for camera in scene.cameras:
            started = time.perf_counter()
            views.append(contender.taps(scene.car.vehicle, camera, scene.car.pyramid))
            times.append(1e3 * (time.perf_counter() - started))
        taps[contender.name], build[contender.name] = views, float(np.median(times))
        moved()
    steps = resident_steps(taps, scene.car.texture(), settings.repeats, moved)
    return [entry for c in contenders for entry in _entries(scene, c, taps[c.name], build[c.name], steps[c.name])]


def warm_up(car: Car, contenders: list[Contender]) -> None:
    """Let every contender build a tiny view: compiling is not what is measured."""
    (camera,) = ring(car.vehicle, "paper", 1, 32)
    for contender in contenders:
        contender.taps(car.vehicle, camera, car.pyramid)


def _taps_per_pixel(taps: Taps) -> float:
    """Over pixels that show paint: others only carry their neighbors' texture, in case the light maps need it."""
    numbers = np.diff(taps.rows.indptr)[taps.alpha > 0]
    return float(numbers.mean()) if len(numbers) else 0.0


def _entries(scene: Scene, contender: Contender, taps: Sequence[Taps], build_ms: float, step: StepTime) -> list[Entry]:
    visible, reached = visible_texels(scene), reached_texels(scene.car.pyramid, taps)
    return [
        Entry(
            name=contender.name,
            vehicle=scene.car.name,
            ring=scene.ring,
            size=scene.size,
            texture=texture,
            samples=contender.samples,
            psnr_db=ring_psnr_db(scene, taps, number),
            forward_ms=step.forward_ms,
            backward_ms=step.backward_ms,
            build_ms=build_ms,
            taps_per_pixel=mean(_taps_per_pixel(view) for view in taps),
            texels_touched=int(reached.sum()),
            reached=float((reached & visible).sum() / max(visible.sum(), 1)),
        )
        for number, texture in enumerate(TEXTURES)
    ]
