"""The report of a run folder: what was measured, what it looks like, and the commands that print each number."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pipelines.stages import Stages
from rauca_core.attack import read_history
from rauca_core.contract import Dataset, RaucaError
from rauca_core.contract.schema import read_json
from rauca_core.evaluate import ReportNotes, save_showcase, write_report


def report_run(run: Path) -> Path:
    """Write ``report.html`` for a folder laid out as the demo's; returns its path.

    Raises:
        RaucaError: the run has no results yet.
    """
    results = run / "results.json"
    if not results.is_file():
        raise RaucaError(f"{run}: has no results.json; run `rauca demo` or `rauca evaluate` first")
    dataset, camouflages = Dataset(run / "held-out"), _camouflages(run)
    made = read_json(run / "rauca" / "camouflage.json").raw("made")
    out = run / "report.html"
    write_report(results, dataset, camouflages, out, _notes(run, dataset, made))
    return out


def picture_run(run: Path, folder: Path) -> list[Path]:
    """Save the report's main figures to ``folder``; returns their paths."""
    white_box = read_json(run / "rauca" / "camouflage.json").raw("made")["detector"]
    return save_showcase(run / "results.json", Dataset(run / "held-out"), _camouflages(run), white_box, folder)


def _camouflages(run: Path) -> list[Path]:
    return [path for name in ("rauca", "random") if (path := run / name / "camouflage.json").is_file()]


def _notes(run: Path, dataset: Dataset, made: dict[str, Any]) -> ReportNotes:
    history = read_history(run / "rauca")
    plan, trained = dataset.plan, Dataset(run / "train")
    return ReportNotes(
        title=f"Camouflage on the {plan.vehicle_name}",
        white_box=(made["detector"],),
        histories={"rauca": {term: [row[term] for row in history] for term in ("attack", "score")}},
        settings={
            "vehicle": plan.vehicle_name,
            "Blender": plan.blender,
            "training frames": f"{len(trained.frames())} at {plan.size} px, {plan.quality.samples} samples",
            "held-out frames": f"{len(dataset.frames())}, another town and other cameras, rendered by Cycles",
            "weathers": ", ".join(weather.name for weather in plan.weathers),
            **{name: value for name, value in made.items() if isinstance(value, str | int | float)},
            **_agreement(run),
        },
        commands=_commands(run),
        timings_s=Stages(run).seconds(),
    )


def _agreement(run: Path) -> dict[str, str]:
    """What the comparison of the two renderers found, if it was made."""
    path = run / "agreement.json"
    if not path.is_file():
        return {}
    found = json.loads(path.read_text())
    shown = {"paint coverage, ours against Cycles": f"mean IoU {found['mean_iou']:.4f}, worst {found['worst_iou']:.4f}"}
    if found["inside_db"] is not None:
        colour = f"{found['inside_db']:.1f} dB inside, {found['edge_db']:.1f} dB on edges"
        shown["camouflage, predicted against Cycles"] = colour
    return shown


def _commands(run: Path) -> list[str]:
    return [
        f"rauca demo --out {run.as_posix()}",
        f"rauca report {run.as_posix()}",
        f"rauca bench render {run.as_posix()}/train --camouflage {run.as_posix()}/rauca/camouflage.json",
    ]


if __name__ == "__main__":
    from pipelines.cli import run as command

    command("report")
