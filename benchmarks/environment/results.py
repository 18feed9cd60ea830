"""Everything one run found, and its JSON."""

from __future__ import annotations

import os
import platform
from dataclasses import asdict, dataclass, field
from typing import Any

import torch

from rauca_core.environment import LightSplitter, PublishedEfe
from rauca_core.environment.weights import parameters

from .compare import Comparison
from .curve import Point
from .settings import Settings
from .textures import TEXTURES
from .trainings import EpochTimes, Trained
from .vehicles import Adapted
from .weighting import Weighting


@dataclass
class Results:
    """Filled part by part.

    Attributes:
        comparison: of the methods, on the sedan.
        exact: exact maps at the data set's default size and budget.
        ours, published: their trainings.
        weighting: None when the ablation was not run.
    """

    settings: Settings
    comparison: Comparison
    exact: Comparison
    ours: Trained
    published: Trained
    epochs: EpochTimes
    weighting: Weighting
    curve: list[Point] = field(default_factory=list)
    vehicles: list[Adapted] = field(default_factory=list)

    def inside_db(self, weather: str) -> float:
        return self.exact.find("exact", [weather], region="inside").psnr_db

    def edge_db(self, weather: str) -> float:
        return self.exact.find("exact", [weather], region="edge").psnr_db

    def to_json(self) -> dict[str, Any]:
        found, times = self.comparison, self.epochs
        return {
            "format": "rauca-bench-environment",
            "version": 1,
            "machine": {"cpus": os.cpu_count(), "processor": platform.machine(), "torch": torch.__version__},
            "settings": asdict(self.settings),
            **{name: found.find(name).to_json() | {"ms": round(found.median_ms(name), 3)} for name in found.methods()},
            "seen": self._over(self.settings.seen),
            "unseen": self._over(self.settings.unseen),
            "weathers": {w: self._over([w]) for w in found.weathers()},
            "textures": {
                t: {name: found.find(name, texture=t).to_json() for name in found.methods()} for t in TEXTURES
            },
            "exact_inside_db": {w: round(self.inside_db(w), 2) for w in self.exact.weathers()},
            "exact_edge_db": {w: round(self.edge_db(w), 2) for w in self.exact.weathers()},
            "parameters": {
                "ours": parameters(LightSplitter()),
                "published": parameters(PublishedEfe(self.settings.widths)),
            },
            "training": {"ours": self.ours.to_json(), "published": self.published.to_json()},
            "epoch_time": times.to_json(),
            "epoch_time_base_over_final": round(times.base / times.final, 3),
            "epoch_time_base_over_ours": round(times.base / times.ours, 3),
            "epoch_time_published_base_over_final": round(times.base_published / times.final, 3),
            "epochs_scratch": {v.vehicle: v.epochs_scratch for v in self.vehicles},
            "epochs_pretrained": {v.vehicle: v.epochs_pretrained for v in self.vehicles},
            "vehicles": [v.to_json() for v in self.vehicles],
            "weight_w": self.weighting.to_json(),
            "curve": [asdict(point) for point in self.curve],
        }

    def _over(self, weathers: Any) -> dict[str, dict[str, float]]:
        found = self.comparison
        return {name: found.find(name, weathers).to_json() for name in found.methods()}
