"""The trade-off curve in numbers and as a page: AP@0.5 against distance from the reference, and against patch size."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any

from .. import __version__
from ..attack.naturalness import Naturalness
from ..attack.naturalness.finish import Distance, distance_of_map
from ..attack.naturalness.granulometry import measure_patches
from ..contract import load_camouflage, load_vehicle
from ..contract.files import write_bytes, write_json
from ..runtime.images import read_image
from ..study.contestants import NORMAL
from ..study.recorded import Recorded
from ..study.results import Estimate
from ..study.study import Entry
from . import pages
from .colors import GREY, PALETTE, Style
from .grid import FramePicker
from .maps import maps_of
from .plots import curve_svg, themed
from .tables import Table
from .tables.html import TableWriter
from .tables.model import Block, Cell, Column, Row

FORMAT = ("rauca-tradeoff", 1)
WHITE, BLACK = "white-box", "black-box, mean"
STYLES = {
    WHITE: Style(*PALETTE[1], "o"),
    BLACK: Style(*PALETTE[0], "s"),
    f"normal paint, {WHITE}": Style(*GREY, "^", "--"),
    f"normal paint, {BLACK}": Style(*GREY, "v", ":"),
}
FINEST_CUBE_M = 0.01


@dataclass(frozen=True)
class Measured:
    """What a camouflage of the curve is, whoever looks at it.

    Attributes:
        bound: on its distance from the reference, None for none; ``feature_cm``: asked for, None for none.
        distance: found, None without a reference.
        smallest_cm, median_cm: sizes of patches found on the vehicle, None where none were asked for.
        losses: means over the last steps of the optimization, as in ``camouflage.json``.
    """

    label: str
    bound: float | None
    feature_cm: float | None
    distance: Distance | None
    smallest_cm: float | None
    median_cm: float | None
    losses: dict[str, float]


@dataclass(frozen=True)
class Curve:
    """Everything that the page shows; ``entries`` are the study's, one per set of weathers."""

    command: str
    attacked: tuple[str, ...]
    reference: Naturalness | None
    points: tuple[Measured, ...]
    entries: tuple[Entry, ...]


def measure_points(
    camouflages: Mapping[str, Path], vehicle_folder: Path, reference: Naturalness | None
) -> tuple[Measured, ...]:
    """Measure every camouflage on the vehicle; raises :class:`RaucaError` for one that is missing or damaged."""
    vehicle, result = load_vehicle(vehicle_folder, read_image), []
    for label, path in camouflages.items():
        record, image = load_camouflage(path)
        uv_map, wanted = read_image(image), record.made["settings"].get("natural") or {}
        feature = wanted.get("feature_cm")
        sizes = None
        if feature is not None:
            sizes = measure_patches(vehicle, uv_map, max(feature / 1000, FINEST_CUBE_M))
        result.append(
            Measured(
                label,
                wanted.get("max_delta_e"),
                feature,
                None if reference is None else distance_of_map(vehicle, uv_map, reference),
                _centimetres(sizes.smallest) if sizes else None,
                _centimetres(sizes.median) if sizes else None,
                record.made["final_losses"],
            )
        )
    return tuple(result)


def _centimetres(metres: float) -> float | None:
    return 100 * metres if math.isfinite(metres) else None


def write_curve(curve: Curve, out: Path) -> list[Path]:
    """Write ``out`` (.html) and its numbers (.json, .csv) beside it; returns what was written, the page first."""
    scores = {entry.weathers: _scores(curve, entry) for entry in curve.entries}
    rows = [_row(point, weathers, table) for weathers, table in scores.items() for point in curve.points]
    name, version = FORMAT
    first = curve.entries[0].results
    value = {
        "format": name, "version": version, "command": curve.command,
        "reference": None if curve.reference is None else curve.reference.reference,
        "white_box": list(curve.attacked), "black_box": _black_box(curve, curve.entries[0]),
        "frames": {entry.weathers: len(entry.results.frames) for entry in curve.entries},
        "intervals": f"95 %, bootstrap over {first.cluster_count} {first.clusters}",
        "normal": {weathers: _flat(table[NORMAL]) for weathers, table in scores.items()},
        "points": rows,
    }  # fmt: skip
    page = _page(curve, scores)
    write_json(out.with_suffix(".json"), value)
    stream = io.StringIO()
    writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_bytes(out.with_suffix(".csv"), stream.getvalue().encode())
    write_bytes(out, page.encode())
    return [out, out.with_suffix(".json"), out.with_suffix(".csv")]


Scores = dict[str, dict[str, Estimate]]  # [paint][WHITE or BLACK]


def _scores(curve: Curve, entry: Entry) -> Scores:
    recorded, others = Recorded(entry), _black_box(curve, entry)
    return {
        paint: {WHITE: recorded.mean_over(curve.attacked, paint), BLACK: recorded.mean_over(others, paint)}
        for paint in entry.results.paints
    }


def _black_box(curve: Curve, entry: Entry) -> list[str]:
    return [name for name in entry.results.detectors if name not in curve.attacked]


def _row(point: Measured, weathers: str, table: Scores) -> dict[str, Any]:
    """One line of numbers; what does not apply is None, an empty field of the CSV."""
    distance = asdict(point.distance) if point.distance else {"mean": None, "largest": None, "mean_2000": None}
    return {
        "label": point.label, "weathers": weathers, "max_delta_e": point.bound, "feature_cm": point.feature_cm,
        "mean_delta_e": distance["mean"], "largest_delta_e": distance["largest"],
        "mean_delta_e_2000": distance["mean_2000"], "smallest_patch_cm": point.smallest_cm,
        "median_patch_cm": point.median_cm, "attack_loss": point.losses["attack"], **_flat(table[point.label]),
    }  # fmt: skip


def _flat(scores: Mapping[str, Estimate]) -> dict[str, float]:
    names = {WHITE: "white_box", BLACK: "black_box"}
    return {
        f"{names[kind]}_{field}": value for kind, one in scores.items() for field, value in asdict(one).items()
    }  # fmt: skip


def _page(curve: Curve, scores: Mapping[str, Scores]) -> str:
    title = "What naturalness costs"
    several = len(scores) > 1
    parts = []
    for weathers, table in scores.items():
        where = f", {weathers} weathers" if several else ""
        parts += _sweep(curve, table, f"Against the distance from the reference{where}", by_distance=True)
        parts += _sweep(curve, table, f"Against the smallest patch{where}", by_distance=False)
    parts += [_numbers(curve, scores), _maps(curve), *_views(curve)]
    lead = (
        f"{len(curve.points)} camouflages against {', '.join(curve.attacked)}, each judged on "
        f"{len(curve.entries[0].results.frames)} held-out views rendered by Cycles. AP@0.5: lower is better hidden. "
        f"Black-box: {', '.join(_black_box(curve, curve.entries[0]))}, never attacked here."
    )
    header = f"<h1>{escape(title)}</h1>" + pages.paragraph(lead, "lead")
    footer = f"Written by rauca {escape(__version__)}: {escape(curve.command)}"
    return pages.page(title, header, parts, footer)


def _sweep(curve: Curve, table: Scores, title: str, by_distance: bool) -> list[str]:
    chosen = _along_distance(curve) if by_distance else _along_size(curve)
    if len(chosen) < 2:
        return []
    axis = "mean CIELAB distance from the reference" if by_distance else "smallest patch asked for, cm (0: free)"
    drawn = _table(axis, chosen, table)
    svg = pages.drawing(themed(curve_svg(drawn, STYLES)), title)
    figure = pages.figure(svg, f"Bands: 95 % intervals by bootstrap over {curve.entries[0].results.clusters}.")
    body = pages.legend(STYLES) + f'<div class="plots">{figure}</div>' + TableWriter(STYLES, {})(drawn)
    return [pages.section(title, body)]


def _along_distance(curve: Curve) -> list[tuple[str, str]]:
    """(label, value) of the points that differ in their bound, nearest first, the free one too."""
    some = [p for p in curve.points if p.distance is not None and p.feature_cm is None]
    ordered = sorted(some, key=lambda p: p.distance.mean if p.distance else 0.0)
    return [(p.label, f"{p.distance.mean:.1f}") for p in ordered if p.distance]


def _along_size(curve: Curve) -> list[tuple[str, str]]:
    some = [p for p in curve.points if p.bound is None]
    ordered = sorted(some, key=lambda p: p.feature_cm or 0.0)
    return [(p.label, f"{p.feature_cm or 0:g}") for p in ordered]


def _table(axis: str, chosen: Sequence[tuple[str, str]], table: Scores) -> Table:
    def row(name: str, paints: Sequence[str], kind: str) -> Row:
        found = [table[paint][kind] for paint in paints]
        return Row(name, tuple(Cell(one.ap, one.low, one.high) for one in found))

    labels = [label for label, _ in chosen]
    rows = [row(kind, labels, kind) for kind in (WHITE, BLACK)]
    # A line to compare with: its interval would only cover the others'.
    plain = {kind: tuple(Cell(table[NORMAL][kind].ap) for _ in labels) for kind in (WHITE, BLACK)}
    rows += [Row(f"normal paint, {kind}", cells) for kind, cells in plain.items()]
    columns = tuple(Column(value) for _, value in chosen)
    return Table("tradeoff", axis, f"AP@0.5 by {axis}.", columns, (Block("", tuple(rows)),))


def _numbers(curve: Curve, scores: Mapping[str, Scores]) -> str:
    """One row per camouflage: what was asked, what it is, what was found."""
    heads = [
        "camouflage",
        "bound",
        "mean dE",
        "mean dE2000",
        "largest dE",
        "patch, cm",
        "smallest found",
        "median found",
    ]
    heads += [f"{kind} {weathers}" for weathers in scores for kind in (WHITE, BLACK)]
    body = ""
    for point in curve.points:
        d = point.distance
        cells = [point.bound, d and d.mean, d and d.mean_2000, d and d.largest, point.feature_cm]
        cells += [point.smallest_cm, point.median_cm]
        shown = ["–" if value is None else f"{value:.1f}" for value in cells]
        shown += [
            f"{one.ap:.3f} ({one.low:.2f}–{one.high:.2f})"
            for table in scores.values()
            for one in (table[point.label][WHITE], table[point.label][BLACK])
        ]
        body += (
            f'<tr><th scope="row">{escape(point.label)}</th>' + "".join(f"<td>{cell}</td>" for cell in shown) + "</tr>"
        )
    head = "".join(f'<th scope="col">{escape(text)}</th>' for text in heads)
    note = (
        "Distances are Euclidean in CIELAB (dE) and CIEDE2000, means over the painted surface. A patch's size is the "
        "diameter of the largest disc inside it, measured on the finished map and the mesh, to about a centimetre or "
        "a tenth of its size."
    )
    table = (
        f'<div class="scroll"><table class="scores"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
    )
    return pages.section("Every camouflage", table, note)


def _maps(curve: Curve) -> str:
    drawn = "".join(
        pages.figure(pages.image(jpeg, "image/jpeg", f"UV map {camouflage.name}"), camouflage.name)
        for camouflage, jpeg in maps_of(curve.entries[:1])
    )
    return pages.section("UV maps", f'<div class="maps">{drawn}</div>')


def _views(curve: Curve) -> list[str]:
    picker = FramePicker(curve.entries[:1])
    grid = picker.grid(curve.attacked[0])
    rows = {
        paint: [
            pages.image(tile, "image/jpeg", f"{paint}, {title.replace(chr(10), ', ')}")
            for title, tile in zip(grid.titles, tiles, strict=True)
        ]
        for paint, tiles in grid.rows.items()
    }
    body = pages.picture_grid(grid.titles, rows)
    return [pages.section(f"What {curve.attacked[0]} sees", body, picker.rule)]
