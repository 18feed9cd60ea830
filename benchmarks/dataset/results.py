"""Everything one run found, and its JSON."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from blender_addon.scene.composed_fog import DENSEST, THINNEST

from .settings import KINDS, Settings

SINGLE, MAPS = "one render", "light maps"
MAIN_SET = "base"  # whose speed is the headline; the others are listed


@dataclass(frozen=True)
class Entry:
    """One setting in one kind of weather.

    Attributes:
        what: ``one render`` of one color, or ``light maps`` that serve every color.
        axis: which setting is varied: samples, raw, adaptive, bounces, fog.
        psnr_db, linear_psnr_db, paint_psnr_db: over views and colors; of display values, of linear light up to
            display white, of display values on the paint.
        cpu_seconds, wall_seconds: of the render, or of both that make a frame's light maps; the weather stands.
    """

    what: str
    axis: str
    kind: str
    samples: int
    adaptive_threshold: float
    denoise: bool
    bounces: int
    composed_fog: bool
    psnr_db: float
    linear_psnr_db: float
    paint_psnr_db: float
    cpu_seconds: float
    wall_seconds: float


@dataclass(frozen=True)
class FogPoint:
    """Display PSNR in dB of a grey vehicle in one fog, on the first of the settings' views.

    Attributes:
        extinction: 1/m on the ground.
        real_db: the real volume, at the default's samples.
        composed_db: composed around the vehicle; what data sets use by day.
        everywhere_db: composed everywhere, the vehicle too.
        formula_db: transmittance times the clear view plus one airlight, both scaled per channel to fit the coarse
            render best: what is possible without neighborhoods.
    """

    light: str
    fog_density: float
    extinction: float
    real_db: float
    composed_db: float
    everywhere_db: float
    formula_db: float


@dataclass(frozen=True)
class WholeSet:
    """CPU seconds of all frames of one view: weathers times colors.

    Attributes:
        ours, ours_wall: light maps of every weather and the colors made of them, coverage included.
        naive: one render per weather and color, at ``naive_samples``; no coverage, though it needs it as much.
        naive_samples: by kind of weather, the fewest denoised ones whose error is ours.
    """

    preset: str
    view: int
    frames: int
    ours: float
    ours_wall: float
    naive: float
    naive_samples: Mapping[str, int]

    @property
    def speedup(self) -> float:
        return self.naive / self.ours


@dataclass(frozen=True)
class Results:
    """One run, as `inside.py` measured it.

    Attributes:
        default: the quality that `rauca dataset make` uses.
        coverage_cpu_seconds: of what a camera sees without weather, once for all its weathers.
        entries: over the renderer's settings; per kind of weather, the default light maps come first.
    """

    settings: Settings
    blender: str
    default: Mapping[str, Any]
    coverage_cpu_seconds: float
    entries: tuple[Entry, ...]
    fog_curve: tuple[FogPoint, ...]
    sets: tuple[WholeSet, ...]

    @staticmethod
    def of(settings: Settings, found: Mapping[str, Any]) -> Results:
        """From the JSON that `inside.py` wrote."""
        return Results(
            settings,
            found["blender"],
            found["default"],
            found["coverage_cpu_seconds"],
            tuple(Entry(**row) for row in found["entries"]),
            tuple(FogPoint(**row) for row in found["fog_curve"]),
            tuple(WholeSet(**row) for row in found["sets"]),
        )

    def of_kind(self, kind: str) -> list[Entry]:
        return [entry for entry in self.entries if entry.kind == kind]

    def at_default(self, kind: str) -> Entry:
        """The default light maps."""
        return next(entry for entry in self.of_kind(kind) if entry.what == MAPS)

    def speedup(self, preset: str) -> float:
        """Over all views on which the preset was rendered."""
        rows = [row for row in self.sets if row.preset == preset]
        return sum(row.naive for row in rows) / sum(row.ours for row in rows)

    @property
    def main_set(self) -> str:
        return MAIN_SET if any(row.preset == MAIN_SET for row in self.sets) else self.sets[0].preset

    def composed_fog_db(self) -> dict[str, float]:
        """Per fog density for which composing is done, the composed frames' PSNR in dB; all else is in the curve."""
        used = (p for p in self.fog_curve if p.light == "day" and THINNEST <= p.extinction <= DENSEST)
        return {f"{p.fog_density:g}": p.composed_db for p in used}

    def to_json(self) -> dict[str, Any]:
        main = [row for row in self.sets if row.preset == self.main_set]
        frames = sum(row.frames for row in main)
        return {
            "format": "rauca-bench-dataset",
            "version": 1,
            "machine": {"cpus": os.cpu_count(), "processor": platform.machine(), "blender": self.blender},
            "settings": self.settings.to_json(),
            "default": dict(self.default),
            "seconds_are": "CPU seconds of all threads, per frame in one color",
            "default_seconds_per_frame": sum(row.ours for row in main) / frames,
            "default_wall_seconds_per_frame": sum(row.ours_wall for row in main) / frames,
            "default_psnr_db": {_short(kind): self.at_default(kind).psnr_db for kind in KINDS},
            "default_linear_psnr_db": {_short(kind): self.at_default(kind).linear_psnr_db for kind in KINDS},
            "default_paint_psnr_db": {_short(kind): self.at_default(kind).paint_psnr_db for kind in KINDS},
            "naive_seconds_per_frame": sum(row.naive for row in main) / frames,
            "speedup_vs_naive": self.speedup(self.main_set),
            "speedup_by_set": {row.preset: self.speedup(row.preset) for row in self.sets},
            "composed_fog_psnr_db": self.composed_fog_db(),
            "coverage_cpu_seconds": self.coverage_cpu_seconds,
            "entries": [asdict(entry) for entry in self.entries],
            "fog_curve": [asdict(point) for point in self.fog_curve],
            "sets": [asdict(row) | {"speedup": row.speedup} for row in self.sets],
        }


def _short(kind: str) -> str:
    return "fog" if kind == "foggy" else kind
