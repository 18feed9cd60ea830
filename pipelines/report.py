"""The report of a study, or of a run folder: what was measured, how it looks, and where each number comes from."""

from __future__ import annotations

from pathlib import Path

from pipelines.stages import Stages
from rauca_core.attack import read_history
from rauca_core.contract import Dataset, RaucaError, load_camouflage
from rauca_core.contract.schema import read_json
from rauca_core.report import ReportNotes, save_showcase, write_report
from rauca_core.study import load_results
from rauca_core.study.study import FILE_NAME, Entry, Study, load_study


def report_run(folder: Path, latex: bool = False) -> Path:
    """Write ``report.html``, ``.csv`` and ``.json`` (and ``.tex``) for a study's folder or one laid out as the demo's.

    Returns:
        The page's path.

    Raises:
        RaucaError: the folder has no results yet, or what it has is damaged.
    """
    study, notes = _opened(folder)
    return write_report(study, folder / "report.html", notes, latex)[0]


def picture_run(folder: Path, pictures: Path) -> list[Path]:
    """Save the report's main figures to ``pictures``; returns their paths."""
    return save_showcase(_opened(folder)[0], pictures)


def _opened(folder: Path) -> tuple[Study, ReportNotes]:
    if (folder / FILE_NAME).is_file():
        return load_study(folder), ReportNotes()
    results = folder / "results.json"
    if not results.is_file():
        raise RaucaError(f"{folder}: has no results.json or {FILE_NAME}; run `rauca evaluate` or `rauca demo` first")
    dataset, found = Dataset(folder / "held-out"), load_results(results)
    entry = Entry(
        "held-out views",
        "none",
        dataset.plan.vehicle_name,
        found.settings.category,
        found,
        folder,
        views=dataset.folder,
        camouflages=_camouflages(folder),
    )
    return Study(f"rauca demo --out {folder.as_posix()}", (entry,)), _notes(folder, dataset)


def _camouflages(run: Path) -> dict[str, Path]:
    return {name: path for name in ("random", "rauca") if (path := run / name / "camouflage.json").is_file()}


def _notes(run: Path, dataset: Dataset) -> ReportNotes:
    history = read_history(run / "rauca")
    made = load_camouflage(run / "rauca" / "camouflage.json")[0].made
    plan, trained = dataset.plan, Dataset(run / "train")
    return ReportNotes(
        title=f"Camouflage on the {plan.vehicle_name}",
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
    found = read_json(path)
    overlap = f"mean IoU {found.number('mean_iou'):.4f}, worst {found.number('worst_iou'):.4f}"
    shown = {"paint coverage, ours against Cycles": overlap}
    if not found.is_null("inside_db"):
        color = f"{found.number('inside_db'):.1f} dB inside, {found.number('edge_db'):.1f} dB on edges"
        shown["camouflage, predicted against Cycles"] = color
    return shown


def _commands(run: Path) -> list[str]:
    return [
        f"rauca report {run.as_posix()}",
        f"rauca bench agreement {run.as_posix()}/train --camouflage {run.as_posix()}/rauca/camouflage.json",
    ]


if __name__ == "__main__":
    from pipelines.cli import run as command

    command("report")
