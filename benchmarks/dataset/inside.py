"""Runs in a process of its own, with Blender: measures everything and writes what it found as JSON.

Usage: python -m benchmarks.dataset.inside SETTINGS.json REFERENCES OUTPUT.json
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import bpy

from rauca_core.contract import Progress
from rauca_core.contract.files import write_json

from .fog_curve import fog_curve
from .naive import naive_samples
from .reference import References
from .settings import KINDS, Settings
from .studio import Studio
from .sweep import measure, variants
from .whole_set import whole_sets


def run(settings: Settings, references_folder: Path) -> dict[str, Any]:
    """Measure; returns sweeps, fog curve and whole sets as JSON."""
    studio = Studio(settings.size, {*settings.views, *(view for _, views in settings.sets for view in views)})
    references = References(studio, references_folder)
    jobs = [(kind, *variant) for kind in KINDS for variant in variants(settings, studio.default)]
    jobs = [job for job in jobs if job[0] == "foggy" or job[2] != "fog"]
    done, total = 0, len(jobs) + 2 * len(settings.fog_densities) + 2 * sum(len(views) for _, views in settings.sets)

    def moved(last: str) -> None:
        nonlocal done
        done += 1
        print(Progress(done, total, last).line(), flush=True)

    entries = []
    for kind, what, axis, quality in jobs:
        entries.append(measure(studio, references, settings, kind, what, axis, quality))
        moved(f"{kind}: {what}, {axis}")
    curve = fog_curve(studio, references, settings, moved)
    samples = {kind: naive_samples([e for e in entries if e.kind == kind]) for kind in KINDS}
    sets = whole_sets(studio, settings, samples, moved)
    return {
        "blender": bpy.app.version_string,
        "default": studio.default.to_json(),
        "coverage_cpu_seconds": studio.coverage.cpu,
        "entries": [asdict(entry) for entry in entries],
        "fog_curve": [asdict(point) for point in curve],
        "sets": [asdict(row) for row in sets],
    }


def main(settings_file: str, references: str, target: str) -> None:
    settings = Settings.from_json(json.loads(Path(settings_file).read_text()))
    write_json(Path(target), run(settings, Path(references)))


if __name__ == "__main__":
    main(*sys.argv[1:])
