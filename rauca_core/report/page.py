"""Pages from templates, which escape whatever they are given: one for each kind of study."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from ..contract.files import file_digest, write_bytes
from ..study.detectors import family_of, in_table_order, is_own
from ..study.study import Study
from ..version import __version__
from .figures import Style, color_rules, curve_svg, is_ring, themed, themed_color
from .study_tables import defence_title, unique, vehicles_of, weathers_title
from .table import Cell, Column, Place, Row, Source, Table, laid_out, listing
from .writers import TEMPLATES, tables_csv, tables_json, tables_latex


@dataclass(frozen=True)
class Behind:
    """What a page tells below its sections, of where its numbers come from.

    Attributes:
        commands: that led to them, the first one in the JSON and LaTeX files too.
        settings: name -> value, as the reader should see them.
        timings_s: stage -> seconds.
        limits: sentences added to what no page says.
        fewest: views that a number is of, at least.
        results, detectors: tables of files and detectors, where there is a study; numbers link to ``anchors``, which
            are the ids of rows in ``results`` by file.
    """

    commands: Sequence[str] = ()
    settings: Mapping[str, object] = field(default_factory=dict)
    timings_s: Mapping[str, float] = field(default_factory=dict)
    limits: Sequence[str] = ()
    fewest: int = 0
    results: Table | None = None
    detectors: Table | None = None
    anchors: Mapping[Path, str] = field(default_factory=dict)


def write_study_page(
    study: Study,
    out: Path,
    template: str,
    told: Mapping[str, Any],
    tables: Sequence[Table],
    about: Mapping[str, Any],
    settings: Mapping[str, object],
    commands: Sequence[str] = (),
    timings_s: Mapping[str, float] | None = None,
    limits: Sequence[str] = (),
    latex: bool = True,
    fewest: int | None = None,
) -> list[Path]:
    """Write the page of a study to ``out`` (.html) and the numbers of some tables beside it (.csv, .json, .tex).

    Args:
        commands: behind the page's numbers, beside the study's own.
        settings, timings_s, limits: see :class:`Behind`; the others are those of :func:`write_page`.
        fewest: as of :class:`Behind`; frames of the smallest entry if left out.

    Returns:
        What was written, the page first.
    """
    first, base = study.entries[0].results, out.parent
    # file of results -> id of the row that tells about it
    anchors = {entry.folder / "results.json": f"data-{i}" for i, entry in enumerate(study.entries, start=1)}
    counted = {
        "lowest score counted": first.settings.score_threshold,
        "overlap of non-maximum suppression": first.settings.iou_threshold,
        "intervals": f"95 %, jackknife over {first.place_kind}, Student's t",
    }
    behind = Behind(
        commands=unique([study.command, *commands]),
        settings={**counted, **settings},
        timings_s=timings_s or {},
        limits=limits,
        fewest=min(len(entry.results.frames) for entry in study.entries) if fewest is None else fewest,
        results=_results(study, base, anchors),
        detectors=_detectors(study),
        anchors=anchors,
    )
    return write_page(out, template, told, tables, about, behind, latex)


def write_page(
    out: Path,
    template: str,
    told: Mapping[str, Any],
    tables: Sequence[Table],
    about: Mapping[str, Any],
    behind: Behind,
    latex: bool = True,
) -> list[Path]:
    """Write a page to ``out`` (.html) and the numbers of some tables beside it (.csv, .json, .tex).

    The page is a document of its own: no script, nothing loaded, no date.

    Args:
        template: file in ``templates/``; extends ``page.html``.
        told: what it is given: ``title``, ``headline`` (the result in one line), ``scope`` (a sentence below it),
            ``lead`` (what was found, a paragraph each), ``styles`` (how rows of these names are marked in tables), and
            what is its own.
        about: more fields of the JSON.
        latex: whether to write the .tex.

    Returns:
        What was written, the page first.
    """
    base, command = out.parent, next(iter(behind.commands), "")
    files = {".csv": tables_csv(tables, base), ".json": tables_json(tables, command, about, base)}
    if latex:
        files[".tex"] = tables_latex(tables, command)
    shared = {
        **{one.name: getattr(behind, one.name) for one in fields(behind)},
        "version": __version__,
        "headline": "",
        "scope": "",
        "styles": {},
        "colors": Markup(color_rules()),
        "base": base,
        "beside": [out.with_suffix(suffix).name for suffix in files],
        "timings": {stage: f"{seconds:.1f} s" for stage, seconds in behind.timings_s.items()},
    }
    page = _environment().get_template(template).render({**shared, **told})
    written = {".html": page.encode(), **files}
    for suffix, data in written.items():
        write_bytes(out.with_suffix(suffix), data)
    return [out.with_suffix(suffix) for suffix in written]


def _results(study: Study, base: Path, anchors: Mapping[Path, str]) -> Table:
    several = len(vehicles_of(study)) > 1
    names = ["vehicle"] * several + ["defence", "frames", "left out", "intervals over", "file"]
    rows = []
    for entry in study.entries:
        results, path = entry.results, entry.folder / "results.json"
        told = [*([entry.vehicle] if several else []), defence_title(entry.defence)]
        told += [str(len(results.frames)), str(len(results.dropped)), results.places]
        file = Source(path, ()).told(base)
        cells = (*map(Cell, told), Cell(file, link=file), Cell(file_digest(path)[:16]))
        rows.append(Row(weathers_title(entry.weathers), cells, anchors[path]))
    columns = (*(Column(name, kind="text") for name in names), Column("sha256", kind="code"))
    return listing("results", "weathers", columns, tuple(rows))


def _detectors(study: Study) -> Table:
    prints = {name: value for entry in study.entries for name, value in entry.results.detectors.items()}
    against: dict[str, list[str]] = {}
    for entry in study.entries:
        for paint, names in entry.against.items():
            for name in names:
                against.setdefault(name, []).append(paint)
    rows = []
    for name in in_table_order(list(prints)):
        trained = "this project's synthetic images" if is_own(name) else "its publisher's images"
        met = ", ".join(unique(against.get(name, []))) or "–"
        rows.append(Row(name, tuple(map(Cell, (family_of(name), trained, met, prints[name][:16])))))
    columns = [Column(name, kind="text") for name in ("family", "trained on", "white-box for")]
    return listing("fingerprints", "detector", (*columns, Column("fingerprint", kind="code")), tuple(rows))


@cache
def _environment() -> Environment:
    found = Environment(
        loader=TEMPLATES, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    found.filters |= {
        "base64": lambda data: base64.b64encode(data).decode("ascii"),
        "breakable": lambda text: Markup(escape(text).replace("-", "-<wbr>")),
        "curve": _curve,
        "is_ring": is_ring,
        "laid_out": laid_out,
        "recall_curve": _recall_curve,
        "small": _small_interval,
        "source": _source,
        "themed": _themed,
        "themed_color": themed_color,
    }
    return found


def _curve(curve: Table, styles: Mapping[str, Style], alt: str) -> Markup:
    return _themed(curve_svg(curve, styles), alt)


def _recall_curve(curve: Table, styles: Mapping[str, Style], alt: str) -> Markup:
    return _themed(curve_svg(curve, styles, "recall"), alt)


def _themed(svg: str, alt: str) -> Markup:
    """An ``<svg>`` element that takes part in the page's colors; ``alt`` says what it shows."""
    return Markup(themed(svg).replace("<svg", f'<svg role="img" aria-label="{escape(alt, quote=True)}"', 1))


def _small_interval(place: Place) -> str:
    """As printed small below a value: without the zero before the point."""
    low, high = place.interval or ("", "")
    if place.column.kind == "change":
        return f"{low} to {high}"
    return f"{low.removeprefix('0')}–{high.removeprefix('0')}"


def _source(place: Place, base: Path) -> str:
    """The value with its interval and where it stands, as shown when it is pointed at on a page in ``base``."""
    if place.cell is None or place.cell.source is None:
        return ""
    source = place.cell.source
    where = f"{source.told(base)}: {' / '.join(key for key in source.keys if key)}"
    ends = place.interval
    return f"{place.shown}, 95 % interval {ends[0]} to {ends[1]}; {where}" if ends else where
