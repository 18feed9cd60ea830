"""Everything one run found, and its JSON."""

from __future__ import annotations

import os
import platform
from dataclasses import asdict, dataclass, field
from typing import Any

import torch

from .blender_agreement import BlenderAgreement
from .measure import Entry
from .raster import RasterTime
from .settings import Settings
from .speed import StepTime
from .speedup import Speedup


@dataclass
class Results:
    """Filled part by part.

    Attributes:
        main: name of the vehicle that targets are judged on: the given one, else the sedan.
        rival: name of that vehicle as Algorithm 2 is judged on it: with every face painted, where its atlas allows.
        reach: of the main vehicle, per renderer, share of visible texels that a larger ring's gradient comes to.
        levels: per vehicle, mip levels from the UV map and back, once per step.
        streamed_ms: per vehicle, 2x2 on the largest paper ring: read from the cache, apply, transpose; per image.
        reference_check_db: per vehicle, Embree's reference against the rasterizer's on one view.
    """

    settings: Settings
    main: str
    rival: str = ""
    renderers: list[Entry] = field(default_factory=list)
    speedups: dict[str, Speedup] = field(default_factory=dict)
    raster: list[RasterTime] = field(default_factory=list)
    reach: dict[str, float] = field(default_factory=dict)
    levels: dict[str, StepTime] = field(default_factory=dict)
    streamed_ms: dict[str, float] = field(default_factory=dict)
    reference_check_db: dict[str, float] = field(default_factory=dict)
    blender: list[BlenderAgreement] = field(default_factory=list)

    @property
    def raster_vs_embree(self) -> float:
        """Through trimesh; the worst of all settings."""
        return max(row.ratio for row in self.raster)

    @property
    def raster_vs_bare_embree(self) -> float:
        return max(row.bare_ratio for row in self.raster)

    def find(self, name: str, texture: str, ring: str = "paper", vehicle: str = "") -> Entry:
        """A renderer's entry for a vehicle, the main one by default, at the largest size."""
        size, vehicle = max(self.settings.sizes), vehicle or self.main
        return next(
            e
            for e in self.renderers
            if (e.name, e.texture, e.ring, e.size, e.vehicle) == (name, texture, ring, size, vehicle)
        )

    def to_json(self) -> dict[str, Any]:
        speedup = self.speedups[self.rival or self.main]
        return {
            "format": "rauca-bench-render",
            "version": 1,
            "machine": {"cpus": os.cpu_count(), "processor": platform.machine(), "torch": torch.__version__},
            "settings": asdict(self.settings),
            "main_vehicle": self.main,
            "rival_vehicle": self.rival or self.main,
            "renderers": [asdict(entry) for entry in self.renderers],
            "speedup_vs_algorithm2": speedup.operator,
            "speedup_vs_algorithm2_single_image_with_levels": speedup.whole_step,
            "raster_vs_embree": self.raster_vs_embree,
            "raster_vs_bare_embree": self.raster_vs_bare_embree,
            "speedups": {name: row.to_json() for name, row in self.speedups.items()},
            "raster": [row.to_json() for row in self.raster],
            "levels": {name: asdict(step) for name, step in self.levels.items()},
            "reach": self.reach,
            "streamed_ms": self.streamed_ms,
            "reference_check_db": self.reference_check_db,
            "blender": [asdict(row) for row in self.blender],
        }
