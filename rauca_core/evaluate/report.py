"""The evaluation as one HTML file that can be mailed, archived and opened anywhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from .. import __version__
from ..contract import Dataset, RaucaError, load_camouflage
from ..contract.files import write_bytes
from ..images import read_image
from . import pages, plots
from .bootstrap import CONFIDENCE
from .grid import PICTURE_THRESHOLD, picture_grid
from .pictures import map_picture
from .results import AXES, MEAN, Results, load_results


@dataclass(frozen=True)
class ReportNotes:
    """What the numbers alone do not say.

    Attributes:
        title: of the page.
        white_box: detectors that the camouflages were optimised against.
        normal: the paint that others are compared with.
        histories: camouflage -> term -> one value per optimisation step.
        settings: name -> value, as the reader should see them.
        commands: that print each number of the report, in order.
        timings_s: stage -> seconds.
        limitations: sentences added to the general ones.
    """

    title: str = "Camouflage evaluation"
    white_box: tuple[str, ...] = ()
    normal: str = "normal"
    histories: Mapping[str, Mapping[str, Sequence[float]]] = field(default_factory=dict)
    settings: Mapping[str, object] = field(default_factory=dict)
    commands: Sequence[str] = ()
    timings_s: Mapping[str, float] = field(default_factory=dict)
    limitations: Sequence[str] = ()


def write_report(
    results_path: Path, dataset: Dataset, camouflages: Sequence[Path], out: Path, notes: ReportNotes | None = None
) -> None:
    """Write the report of ``results.json`` to ``out`` (.html): self-contained, no script, nothing loaded.

    Args:
        results_path: as written by :func:`rauca_core.evaluate.evaluate`; the detections beside it are drawn.
        dataset: that was evaluated; gives the paint mask that outlines the UV maps.
        camouflages: JSON (or PNG) paths of those to show.

    Raises:
        RaucaError: results, images, detections or camouflages that are missing or do not belong together.
    """
    notes = notes or ReportNotes()
    results = load_results(results_path)
    if unknown := set(notes.white_box) - set(results.detectors):
        raise RaucaError(f"{results_path}: white-box detector {', '.join(sorted(unknown))} was not evaluated")
    sections = [
        _scores(results, notes),
        *_grids(results, results_path.parent, notes),
        _curves(results),
        *_maps(dataset, camouflages),
        *_training(notes),
        _settings(results, notes),
        _limitations(results, notes),
    ]
    footer = f"Written by rauca {escape(__version__)}. Every picture and curve is inside this file."
    write_bytes(out, pages.page(notes.title, _header(results, notes), sections, footer).encode())


def _header(results: Results, notes: ReportNotes) -> str:
    weathers = len({row.weather for row in results.frames})
    views = len({(row.azimuth_deg, row.elevation_deg, row.distance_m) for row in results.frames})
    scope = (
        f"{len(results.frames)} frames of data set {results.dataset}: {views} camera positions, {weathers} weathers; "
        f"{len(results.paints)} paints, {len(results.detectors)} detectors."
    )
    lead = f'<p class="lead">{escape(_headline(results, notes))}</p>'
    return f"<h1>{escape(notes.title)}</h1><p>{escape(scope)}</p>{lead}"


def _headline(results: Results, notes: ReportNotes) -> str:
    """One sentence: how far the most effective paint lowers AP."""
    means = {paint: row[MEAN].ap for paint, row in results.table.items()}
    if notes.normal not in means or len(means) < 2:
        return "Mean AP@0.5 over detectors: " + ", ".join(f"{p} {100 * ap:.1f} %" for p, ap in means.items()) + "."
    best = min((paint for paint in means if paint != notes.normal), key=means.__getitem__)
    verb = "lowers" if means[best] < means[notes.normal] else "does not lower"
    overlap = results.table[best][MEAN].high >= results.table[notes.normal][MEAN].low
    caution = "; their intervals overlap, so other frames might say otherwise." if overlap else "."
    return (
        f"{best} {verb} {results.settings.category} AP@0.5 (mean over detectors): "
        f"{100 * means[notes.normal]:.1f} % for {notes.normal}, {100 * means[best]:.1f} % for {best}{caution}"
    )


def _scores(results: Results, notes: ReportNotes) -> str:
    note = (
        f"{results.settings.category.capitalize()} AP@0.5 in percent; lower means harder to detect. Below each value: "
        f"{100 * CONFIDENCE:.0f} % bootstrap interval over frames ({results.resamples} resamples, seed {results.seed})."
    )
    if notes.white_box:
        note += " White-box: a camouflage was optimised against this detector; the others never saw it."
    return pages.section(
        "Average precision", pages.scores_table(results, plots.paint_colours(results), notes.white_box), note
    )


def _grids(results: Results, folder: Path, notes: ReportNotes) -> list[str]:
    """One grid of pictures per white-box detector (or for the first detector)."""
    return [_grid(results, folder, name) for name in (notes.white_box or tuple(results.detectors)[:1])]


def _grid(results: Results, folder: Path, detector: str) -> str:
    grid = picture_grid(results, folder, detector)
    rows = {
        paint: [
            pages.image(tile, "image/jpeg", f"{paint}, {title}, {detector}")
            for title, tile in zip(grid.titles, tiles, strict=True)
        ]
        for paint, tiles in grid.rows.items()
    }
    note = (
        f"Cut out around the vehicle; detections that score {PICTURE_THRESHOLD} or more. White dashes: ground truth. "
        f"Green: the {results.settings.category} found. Red: a {results.settings.category} reported elsewhere. "
        "Amber: taken for something else."
    )
    return pages.section(f"What {detector} sees", pages.picture_grid(grid.titles, rows), note)


def _curves(results: Results) -> str:
    varied = [axis for axis in AXES if len(results.groups[axis]) > 1]
    fixed = [f"{plots.AXIS_TITLES[a]}: {results.groups[a][0].value:g}" for a in AXES if a not in varied]
    drawn = "".join(
        pages.figure(
            pages.image(plots.curve_svg(results, axis), "image/svg+xml", f"AP@0.5 against {plots.AXIS_TITLES[axis]}"),
            f"{plots.AXIS_TITLES[axis]}; " + _sizes([group.frames for group in results.groups[axis]]),
        )
        for axis in varied
    )
    note = (
        "AP@0.5, mean over detectors, of all frames that share a value, whatever else they vary in (nominal camera, "
        "before jitter)."
    )
    if fixed:
        note += " Not varied in this data set: " + "; ".join(fixed) + "."
    body = pages.legend(plots.paint_colours(results)) + f'<div class="plots">{drawn}</div>'
    return pages.section("Along camera and weather", body, note)


def _sizes(frames: Sequence[int]) -> str:
    few, many = min(frames), max(frames)
    return f"{few} frames per point" if few == many else f"{few} to {many} frames per point"


def _maps(dataset: Dataset, camouflages: Sequence[Path]) -> list[str]:
    if not camouflages:
        return []
    mask = read_image(dataset.vehicle_folder / "paint_mask.png")
    drawn = []
    for path in camouflages:
        camouflage, uv_map = load_camouflage(path)
        camouflage.check_fits(dataset.plan.atlas_id, str(path))
        caption = f"{camouflage.name}: {camouflage.size} x {camouflage.size} texels, method {camouflage.method}"
        drawn.append(pages.figure(pages.image(map_picture(uv_map, mask), "image/png", caption), caption))
    note = "sRGB UV maps over the vehicle's atlas; outlined: paint that may change; faded: never seen on the car."
    return [pages.section("UV maps", f'<div class="maps">{"".join(drawn)}</div>', note)]


def _training(notes: ReportNotes) -> list[str]:
    if not notes.histories:
        return []
    img = pages.image(plots.history_svg(notes.histories), "image/svg+xml", "loss against optimisation step")
    return [pages.section("Optimisation", pages.figure(img, "Each term of the loss against the optimisation step."))]


def _settings(results: Results, notes: ReportNotes) -> str:
    shown = {
        "target class": results.settings.category,
        "lowest score counted": results.settings.score_threshold,
        "suppression overlap": results.settings.iou_threshold,
        "frames": len(results.frames),
        "frames without a visible vehicle, left out": len(results.dropped),
        **{f"fingerprint of {name}": value[:16] for name, value in results.detectors.items()},
        **notes.settings,
    }
    body = pages.facts(shown)
    if notes.timings_s:
        body += "<h3>Time taken</h3>" + pages.facts({stage: f"{s:.1f} s" for stage, s in notes.timings_s.items()})
    if notes.commands:
        body += "<h3>Commands that print these numbers</h3>" + pages.commands(notes.commands)
    return pages.section("Settings", body)


def _limitations(results: Results, notes: ReportNotes) -> str:
    general = [
        "Rendered frames are not photographs: what holds here need not hold for a real vehicle, camera and paint.",
        "The intervals say how much the numbers would move with other frames of the same kind; frames of one ring are "
        "alike, and neither other places nor other vehicles nor other training runs are part of them.",
        "Every image holds one target; a detection of its class anywhere else counts as a false positive.",
    ]
    if len(results.frames) < 100:
        general.append(f"{len(results.frames)} frames are few: read differences of some points with care.")
    return pages.section("Limitations", pages.bullets([*general, *notes.limitations]))
