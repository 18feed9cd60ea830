"""The trade-off curve as a page: AP@0.5 against distance from the reference, and against patch size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ..study.candidates import NORMAL
from ..study.results import Estimate
from ..study.study import Entry
from ..study.tradeoff import TradeOff
from .figures import GREY, PALETTE, Style
from .frames import FramePicker
from .page import write_study_page
from .pictures import maps_of
from .study_tables import sourced, weathers_title
from .table import Block, Cell, Column, Row, Table, listing

WHITE, BLACK = "white-box", "black-box, mean"
STYLES = {
    WHITE: Style(*PALETTE[1], "o"),
    BLACK: Style(*PALETTE[0], "s"),
    f"normal paint, {WHITE}": Style(*GREY, "^", "--"),
    f"normal paint, {BLACK}": Style(*GREY, "v", ":"),
}


def write_curve(curve: TradeOff, out: Path) -> list[Path]:
    """Write ``out`` (.html) and its numbers (.csv, .json, .tex) beside it; returns what was written, the page first.

    Raises:
        RaucaError: images, detections or camouflages of the study are missing; then nothing was written.
    """
    entries = curve.study.entries
    results, scores = entries[0].results, [_scores(curve, entry) for entry in entries]
    numbers = _numbers(curve, scores)
    sweeps = [sweep for entry, found in zip(entries, scores, strict=True) for sweep in _sweeps(curve, entry, found)]
    picker, attacked = FramePicker(entries[:1]), curve.attacked[0]
    told = {
        "title": "What naturalness costs",
        "lead": [
            f"{len(curve.points)} camouflages against {', '.join(curve.attacked)}, each judged on "
            f"{len(results.frames)} held-out views rendered by Cycles. AP@0.5: lower is better hidden. Black-box: "
            f"{', '.join(_black_box(curve))}, never attacked here."
        ],
        "styles": STYLES,
        "places": results.place_kind,
        "sweeps": sweeps,
        "numbers": numbers,
        "maps": maps_of(entries[:1]),
        "attacked": attacked,
        "picker": picker,
        "grid": picker.grid(attacked),
    }
    about = {
        "reference": None if curve.reference is None else curve.reference.reference,
        "white_box": list(curve.attacked),
        "black_box": _black_box(curve),
        "frames": {entry.weathers: len(entry.results.frames) for entry in entries},
        "intervals": f"95 %, over {results.places}",
    }
    return write_study_page(curve.study, out, "tradeoff.html", told, [numbers, *sweeps], about, {})


Scores = Mapping[str, Mapping[str, Estimate]]  # [paint][WHITE or BLACK]


def _scores(curve: TradeOff, entry: Entry) -> Scores:
    kinds = {WHITE: curve.attacked, BLACK: _black_box(curve)}
    return {
        paint: {kind: entry.recorded.mean_over(names, paint) for kind, names in kinds.items()}
        for paint in entry.results.paints
    }


def _black_box(curve: TradeOff) -> list[str]:
    return [name for name in curve.study.entries[0].results.detectors if name not in curve.attacked]


def _sweeps(curve: TradeOff, entry: Entry, scores: Scores) -> list[Table]:
    """AP along the distance of points that differ in their bound, and along their patches; the free one is in both."""
    near = [(p.distance.mean, p.label) for p in curve.points if p.distance is not None and p.feature_cm is None]
    fine = [(p.feature_cm or 0.0, p.label) for p in curve.points if p.bound is None]
    axes = (
        ("distance", "mean CIELAB distance from the reference", [(label, f"{d:.1f}") for d, label in sorted(near)]),
        ("patch", "smallest patch asked for, cm (0: free)", [(label, f"{size:g}") for size, label in sorted(fine)]),
    )
    where = weathers_title(entry.weathers) if len(curve.study.entries) > 1 else ""

    def cell(paint: str, kind: str) -> Cell:
        return sourced(scores[paint][kind], entry, "table", paint)

    def table(key: str, axis: str, places: Sequence[tuple[str, str]]) -> Table:
        rows = [Row(kind, tuple(cell(label, kind) for label, _ in places)) for kind in (WHITE, BLACK)]
        for kind in (WHITE, BLACK):  # a line to compare with: its interval would only cover the others'
            plain = replace(cell(NORMAL, kind), low=None, high=None)
            rows.append(Row(f"normal paint, {kind}", (plain,) * len(places)))
        columns = tuple(Column(value) for _, value in places)
        blocks = (Block(where, tuple(rows)),)
        return Table(f"{key}-{entry.weathers}", axis, f"AP@0.5 by {axis}.", columns, blocks, ranked=False)

    return [table(*axis) for axis in axes if len(axis[2]) > 1]


def _numbers(curve: TradeOff, scores: Sequence[Scores]) -> Table:
    """A row per camouflage: what was asked, what it is, what was found."""
    rows = []
    for point in curve.points:
        d = point.distance
        distances = (None, None, None) if d is None else (d.mean, d.mean_2000, d.largest)
        patches = point.feature_cm, point.smallest_cm, point.median_cm
        told = point.bound, *distances, *patches, point.losses["attack"]
        cells = [None if value is None else Cell(value) for value in told]
        for entry, found in zip(curve.study.entries, scores, strict=True):
            cells += [sourced(one, entry, "table", point.label) for one in found[point.label].values()]
        rows.append(Row(point.label, tuple(cells)))
    distance = ("bound", "mean dE", "mean dE2000", "largest dE")
    patch = ("asked for", "smallest found", "median found")
    columns = [
        *(Column(name, "distance", kind="number") for name in distance),
        *(Column(name, "patch, cm", kind="number") for name in patch),
        Column("attack loss", kind="loss"),
        *(Column(kind, weathers_title(entry.weathers)) for entry in curve.study.entries for kind in (WHITE, BLACK)),
    ]
    return listing("tradeoff", "camouflage", tuple(columns), tuple(rows), "Every camouflage")
