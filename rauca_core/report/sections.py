"""The sections of the report, each from the part of the study that it shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from ..study.defended import NO_DEFENCE
from ..study.families import family_of, in_table_order
from ..study.study import Entry, Study
from . import pages, plots
from .colors import Style
from .grid import PICTURE_THRESHOLD, FramePicker
from .maps import maps_of
from .tables import PaperTable, Table, odd_averages, paper_tables, white_box_of
from .tables.html import TableWriter
from .tables.of_study import unique, vehicles_of, weathers_title

MAX_PICTURES = 100  # keeps the page's size in hand, about 15 kB each
MAX_MAPS = 8


def tables(drawn: Sequence[Table], study: Study, write: TableWriter) -> list[str]:
    """A section per table; under the last of its kind, what the paper printed."""
    published = {paper.beside: paper for paper in paper_tables()}
    sections = []
    for index, table in enumerate(drawn):
        kind = _kind(table)
        last = all(_kind(other) != kind for other in drawn[index + 1 :])
        body = write(table) + (published_aside(published[kind], write) if last and kind in published else "")
        sections.append(pages.section(table.title, body, "" if index else _reading(drawn, study)))
    return sections


def _kind(table: Table) -> str:
    return table.key.partition("-")[0]


def _reading(drawn: Sequence[Table], study: Study) -> str:
    """How to read the tables, said above the first."""
    first = study.entries[0].results
    columns = [column for table in drawn for column in table.columns]
    notes = [
        "AP@0.5 from 0 to 1; the lower, the better the camouflage. Lowest in bold, second underlined; values that "
        "print alike share the rank, and the vehicle's normal paint takes no part.",
        f"Below each value: its 95 % interval, by bootstrap over {first.clusters}.",
    ]
    if any(column.white_box for column in columns):
        notes.append("White-box: a camouflage was optimized against this detector (shaded where the two meet).")
    if any(column.own for column in columns):
        notes.append(
            "Own, synthetic: trained by this project on its own renderings, unlike the pre-trained ones; the second "
            "average leaves them out."
        )
    return " ".join(notes)


def published_aside(paper: PaperTable, write: TableWriter) -> str:
    """The paper's table, marked off from ours."""
    notes = [
        "As printed, not measured here: another simulator, vehicle and places, and other detectors, so compare the "
        "order and the size of effects rather than digits."
    ]
    if any(column.name == "DDTR" for column in paper.table.columns):
        notes.append("Its groups are kept: it counts DDTR, a transformer, among the single-stage detectors.")
    if odd := odd_averages(paper.table):
        notes.append(f"Printed averages that are not the mean of their row: {'; '.join(odd)}.")
    return (
        f'<aside class="published"><h3>{paper.table.title}: published figures</h3>'
        f"{pages.paragraph(' '.join(notes))}{write(paper.table)}</aside>"
    )


def curves(drawn: Mapping[str, Sequence[Table]], styles: Mapping[str, Style], write: TableWriter) -> list[str]:
    """A panel of plots per set of weathers."""
    note = (
        "AP@0.5, mean over detectors, of all undefended frames that share a value, whatever else they vary in (nominal "
        "camera, before jitter). Bands and whiskers: 95 % intervals. The numbers are below each plot."
    )
    panels = []
    for weathers, some in drawn.items():
        if not some:
            continue
        paints = [row.name for row in some[0].blocks[0].rows]
        title = f"<h3>{escape(weathers_title(weathers))}</h3>" if len(drawn) > 1 else ""
        plotted = "".join(_curve(curve, styles, write) for curve in some)
        legend = pages.legend({paint: styles[paint] for paint in paints})
        panels.append(f'{title}{legend}<div class="plots">{plotted}</div>')
    return [pages.section("Along camera and weather", "".join(panels), note)] if panels else []


def _curve(curve: Table, styles: Mapping[str, Style], write: TableWriter) -> str:
    drawn = pages.drawing(plots.themed(plots.curve_svg(curve, styles)), f"AP@0.5 of every paint: {curve.caption}")
    numbers = f"<details><summary>Numbers</summary>{write(curve)}</details>"
    return pages.figure(drawn, curve.caption, numbers, "ring" if plots.is_ring(curve) else "")


def pictures(study: Study) -> list[str]:
    """Grids of the first vehicle's frames for the detectors that were attacked, then one of every other family."""
    entries = study.of(vehicle=vehicles_of(study)[0], defence=NO_DEFENCE)
    if not entries:
        return []
    picker = FramePicker(entries)
    size = picker.columns * len(picker.paints)
    asked = shown_detectors(entries)
    shown = asked[: max(1, MAX_PICTURES // size)]
    grids = "".join(_grid(picker, name) for name in shown)
    note = (
        f"{picker.rule} Cut out around the vehicle. Thin white: the true box. Detections that score "
        f"{PICTURE_THRESHOLD} or more: blue finds the {entries[0].category}, red reports one elsewhere, yellow takes "
        "it, or something else, for another thing."
    )
    if left := asked[len(shown) :]:
        note += f" Left out for the page's size: {', '.join(left)}."
    return [pages.section("What detectors see", grids, note)]


def shown_detectors(entries: Sequence[Entry]) -> list[str]:
    """Those that were attacked, then the first of every other family."""
    names = in_table_order(list(entries[0].results.detectors))
    met = {name for entry in entries for against in white_box_of(entry).values() for name in against}
    attacked = [name for name in names if name in met]
    families = {family_of(name) for name in attacked}
    others = [next(n for n in names if family_of(n) == f) for f in unique(map(family_of, names)) if f not in families]
    return [*attacked, *others]


def _grid(picker: FramePicker, detector: str) -> str:
    grid = picker.grid(detector)
    rows = {
        paint: [
            pages.image(tile, "image/jpeg", f"{paint}, {title.replace(chr(10), ', ')}, seen by {detector}")
            for title, tile in zip(grid.titles, tiles, strict=True)
        ]
        for paint, tiles in grid.rows.items()
    }
    return f"<h3>{escape(detector)}</h3>" + pages.picture_grid(grid.titles, rows)


def maps(study: Study) -> list[str]:
    """The UV maps of all camouflages, each once."""
    drawn, every = [], maps_of(study.entries)
    for camouflage, jpeg in every[:MAX_MAPS]:
        caption = f"{camouflage.name} for the {camouflage.vehicle_name}: {camouflage.size} × {camouflage.size} texels"
        drawn.append(pages.figure(pages.image(jpeg, "image/jpeg", f"UV map {caption}"), caption))
    note = "sRGB UV maps over the vehicle's atlas; outlined: paint that may change; faded: never seen on the vehicle."
    if len(every) > MAX_MAPS:
        note += f" The first {MAX_MAPS} of {len(every)}."
    return [pages.section("UV maps", f'<div class="maps">{"".join(drawn)}</div>', note)] if drawn else []


def training(histories: Mapping[str, Mapping[str, Sequence[float]]]) -> list[str]:
    if not histories:
        return []
    drawn = pages.drawing(plots.themed(plots.history_svg(histories)), "loss against optimization step")
    figure = pages.figure(drawn, "Each term of the loss against the optimization step.", kind="history")
    return [pages.section("Optimization", figure)]


def limitations(study: Study, more: Sequence[str]) -> str:
    general = [
        "Rendered frames are not photographs: what holds here need not hold for a real vehicle, camera and paint.",
        "The intervals say how much the numbers would move with other draws of what the bootstrap draws; other towns, "
        "other vehicles and other optimization runs are not part of them.",
        "Every image holds one target; a detection of its class anywhere else counts as a false positive.",
    ]
    fewest = min(len(entry.results.frames) for entry in study.entries)
    if fewest < 100:
        general.append(f"{fewest} frames are few: read small differences with care.")
    return pages.section("Limitations", pages.bullets([*general, *more]))
