"""What data sets are meant to reach, beside what they did. Printed, never asserted: times depend on the machine."""

from __future__ import annotations

from dataclasses import dataclass

from .results import Results
from .settings import KINDS

PSNR_DB = {"clear": 35.0, "foggy": 33.0, "night": 33.0}
COMPOSED_DB = 35.0
SPEEDUP = 10.0


@dataclass(frozen=True)
class Target:
    """Passes if ``found`` is at least ``wanted``."""

    what: str
    wanted: float
    found: float
    unit: str

    @property
    def passed(self) -> bool:
        return self.found >= self.wanted


def judge(results: Results) -> list[Target]:
    """All targets; composed fog is judged at the densities for which it is used."""
    rows = [Target(f"default frames, {kind}", PSNR_DB[kind], results.at_default(kind).psnr_db, "dB") for kind in KINDS]
    used = results.composed_fog_db() if results.default["composed_fog"] else {}
    rows += [Target(f"composed fog, density {name}", COMPOSED_DB, found, "dB") for name, found in used.items()]
    presets = dict.fromkeys(row.preset for row in results.sets)
    rows += [Target(f"times as fast as naive, {name}", SPEEDUP, results.speedup(name), "times") for name in presets]
    return rows
