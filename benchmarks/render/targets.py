"""What the renderer is meant to reach, beside what it did. Printed, never asserted: times depend on the machine."""

from __future__ import annotations

from dataclasses import dataclass

from .contenders import ALGORITHM_2, ours
from .results import Results
from .textures import TEXTURES

PSNR_DB = {2: 28.0, 4: 35.0, 8: 41.0}


@dataclass(frozen=True)
class Target:
    """``found`` passes if it is at least, or with ``most`` at most, ``wanted``."""

    what: str
    wanted: float
    found: float
    unit: str = ""
    most: bool = False

    @property
    def passed(self) -> bool:
        return self.found <= self.wanted if self.most else self.found >= self.wanted


def judge(results: Results) -> list[Target]:
    """All targets, on the main vehicle's paper ring at the largest size; Blender's on every vehicle."""
    found = results.find
    rows = [
        Target(f"{ours(n)}, {texture}", wanted, found(ours(n), texture).psnr_db, "dB")
        for n, wanted in PSNR_DB.items()
        for texture in TEXTURES
        if n in results.settings.samples
    ]
    two = found(ours(2), TEXTURES[0])
    rival = results.rival or results.main
    for texture in TEXTURES:
        gap = found(ours(2), texture, vehicle=rival).psnr_db - found(ALGORITHM_2, texture, vehicle=rival).psnr_db
        rows.append(Target(f"less error than {ALGORITHM_2}, {texture}, {rival}", 10, gap, "dB"))
    rows += [
        Target(f"times as fast as {ALGORITHM_2}, {rival}", 150, results.speedups[rival].operator),
        Target("rasterizer's time over Embree's, worst", 1, results.raster_vs_embree, most=True),
        Target("forward + backward, 2x2, in memory", 1, two.step_ms, "ms", most=True),
        Target("forward + backward, 2x2, from the cache", 3, results.streamed_ms[results.main], "ms", most=True),
        Target("visible texels that receive gradient, 8x8", 100, 100 * results.reach[ours(8)], "%"),
    ]
    for row in results.blender:
        rows += [
            Target(f"{row.vehicle} against Cycles inside, 4x4", 48, row.inside_db, "dB"),
            Target(f"{row.vehicle} against Cycles on edges, 4x4", 38, row.edge_db, "dB"),
            Target(f"{row.vehicle} mask IoU with Cycles, 12x12, mean", 0.998, row.iou_mean["12"]),
            Target(f"{row.vehicle} UV error, median", 0.05, row.uv_median, "texel", most=True),
            Target(f"{row.vehicle} UV error, 99th percentile", 0.5, row.uv_p99, "texel", most=True),
        ]
    return rows
