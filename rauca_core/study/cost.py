"""What an assessment of a detector will take on this machine, before it begins."""

from __future__ import annotations

import os
from dataclasses import dataclass

from ..contract.schema import Record

# CPU seconds of a frame of 320 x 320 pixels in an assessment, whose views stand one or two in a place and in all
# weathers: a view in the vehicle's own paint, the same view in another one, a view with light maps, and its taps. The
# first three were measured on a processor that renders half as fast as that of docs/speed.md, and halved.
VIEW_S, REPAINTED_S, LIT_S, TAPS_S = 6.7, 1.8, 7.4, 0.3
# Of clips, whose frames share a place and a weather: as docs/speed.md has them.
DRIVEN_S, DRIVEN_REPAINTED_S = 2.96, 1.4
# Bytes of each at 320 x 320 pixels, rounded up.
VIEW_BYTES, REPAINTED_BYTES, LIT_BYTES, TAPS_BYTES = 260_000, 170_000, 800_000, 2_200_000
DRIVEN_PAINTS = 4  # of clips in an assessment: plain, random, the library's worst, and one against the detector
BESIDE_THE_DETECTOR = 1.15  # of a step: renderer, augmentation and Adam


@dataclass(frozen=True)
class Work(Record):
    """What is to be done, over all vehicles.

    Attributes:
        views: rendered to be judged.
        paints: that each of them is seen in, the vehicle's own included.
        lit_views: rendered with light maps, to optimize on; 0 without an attack on the detector itself.
        steps: of all optimizations together.
        batch: images of a step.
        driven: frames of clips, each seen in ``DRIVEN_PAINTS``.
    """

    views: int
    paints: int
    lit_views: int = 0
    steps: int = 0
    batch: int = 4
    driven: int = 0


@dataclass(frozen=True)
class Cost(Record):
    """Estimated wall seconds on this machine when it does nothing else, and bytes of disk.

    Attributes:
        render_s: of views and light maps, which are kept for the next detector.
        look_s: the detector in every view and paint.
        attack_s: the optimizations; 0 for a detector without gradients.
        disk_bytes: of all that is kept.
    """

    render_s: float
    look_s: float
    attack_s: float
    disk_bytes: int

    @property
    def seconds(self) -> float:
        return self.render_s + self.look_s + self.attack_s


def cost_of(work: Work, ms_forward: float, ms_step: float | None, cores: int | None = None) -> Cost:
    """Estimate a cost.

    Args:
        ms_forward: of an image in the detector.
        ms_step: of an image there and back; None without gradients, where nothing is optimized.
        cores: that Blender renders on; those of this machine if left out.
    """
    attacked = ms_step is not None
    lit, steps = (work.lit_views, work.steps) if attacked else (0, 0)
    repainted, redriven = work.views * (work.paints - 1), work.driven * (DRIVEN_PAINTS - 1)
    cpu_s = work.views * VIEW_S + repainted * REPAINTED_S + lit * (LIT_S + TAPS_S)
    cpu_s += work.driven * DRIVEN_S + redriven * DRIVEN_REPAINTED_S
    views, again = work.views + work.driven, repainted + redriven
    size = views * VIEW_BYTES + again * REPAINTED_BYTES + lit * (LIT_BYTES + TAPS_BYTES)
    return Cost(
        render_s=round(cpu_s / (cores or os.cpu_count() or 1), 1),
        look_s=round((views + again) * ms_forward / 1000, 1),
        attack_s=round(steps * work.batch * (ms_step or 0.0) / 1000 * BESIDE_THE_DETECTOR, 1),
        disk_bytes=size,
    )
