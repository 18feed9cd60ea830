"""An ablation as one HTML file, and its numbers beside it: its table, the paper's, and what became of its orderings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..study.ablations.findings import Findings, Outcome, Scores, Verdict
from ..study.candidates import NORMAL, RANDOM
from ..study.detectors import in_table_order
from ..study.intervals import SEEDS_NEEDED
from ..study.parts import leading
from ..study.results import Estimate
from ..study.study import Entry
from .figures import paint_styles
from .frames import FramePicker, Grid, Picture
from .page import write_study_page
from .pictures import maps_of
from .published import PaperTable, paper_tables
from .study_tables import average_columns, detector_columns, sourced, unique, weathers_title
from .table import AVERAGE, Block, Cell, Column, Row, Source, Table, listing

_MARKS: dict[Outcome, str] = {"confirmed": "✓", "refuted": "✗", "undecided": "?"}
_LIMIT = (
    "Each interval is for itself; only verdicts are corrected for how many orderings are judged. Random paint is one "
    "paint, not every random one."
)


def write_ablation(found: Findings, out: Path) -> list[Path]:
    """Write ``out`` (.html) and its numbers (.csv, .json, .tex) beside it.

    Returns:
        What was written, the page first.

    Raises:
        RaucaError: images, detections or camouflages of the study are missing; then nothing was written.
    """
    study, experiment = found.study, found.experiment
    scores = found.scores()
    verdicts, main = found.verdicts(scores), _main_table(found, scores)
    paper = next((one for one in paper_tables() if one.beside == experiment.paper), None)
    beside = None if paper is None else _beside_table(found, scores, paper)
    gaps = _gaps(found, verdicts) if verdicts else None
    told = {
        "title": experiment.title,
        "scope": experiment.question,
        "lead": _lead(verdicts),
        "styles": paint_styles(found.titles.values()),
        "found": found,
        "places": study.entries[0].results.place_kind,
        "seeds_needed": SEEDS_NEEDED,
        "orderings": [f"{_MARKS[verdict.outcome]} {verdict.sentence(found.titles)}" for verdict in verdicts],
        "gaps": gaps,
        "main": main,
        "beside_table": beside,
        "paper": paper,
        "own_settings": _settings(found),
        **_pictures(found),
    }
    tables = [table for table in (main, beside, gaps) if table is not None]
    about = _about(found, verdicts)
    return write_study_page(
        study, out, "ablation.html", told, tables, about, {}, timings_s=found.timings_s, limits=[_LIMIT]
    )


def _lead(verdicts: Sequence[Verdict]) -> list[str]:
    counts = Counter(verdict.outcome for verdict in verdicts if verdict.claim.by == "the paper")
    told = ", ".join(f"{counts[outcome]} {outcome}" for outcome in _MARKS if counts[outcome])
    return [f"Of the paper's orderings: {told}."] if told else []


def _main_table(found: Findings, scores: Scores) -> Table:
    """AP of every row and detector, a block per set of weathers."""
    names = in_table_order(list(scores.detectors))
    blocks = []
    for entry in found.study.entries:
        rows = []
        for row, title in found.titles.items():
            attacked = found.attacked if row not in (NORMAL, RANDOM) else ()
            means = [_cell(found, scores, row, entry, some) for some in found.parts.values()]
            cells = [_cell(found, scores, row, entry, [name], name in attacked) for name in names]
            rows.append(Row(title, (*means, *cells)))
        blocks.append(Block(weathers_title(entry.weathers), tuple(rows)))
    repeats = f", mean of {found.seeds} optimizations" if found.seeds > 1 else ""
    category = found.study.entries[0].category.capitalize()
    part, deciding = leading(found.parts)
    caption = f"{category} AP@0.5{repeats}. What decides is the mean over {', '.join(deciding)} ({part})."
    columns = (*average_columns(found.parts), *detector_columns(names, found.attacked))
    return Table(f"ablation-{found.experiment.name}", found.experiment.title, caption, columns, tuple(blocks))


def _cell(
    found: Findings,
    scores: Scores,
    row: str,
    entry: Entry,
    detectors: Sequence[str],
    white_box: bool = False,
) -> Cell:
    """AP of a row; where it is a mean, its source is what holds all of its parts."""
    estimate, paints = scores.ap(row, detectors, [entry.weathers]), found.paints[row]
    alone = len(paints) == 1
    keys = ("table", *(paints if alone else ()), *(detectors if alone and len(detectors) == 1 else ()))
    return sourced(estimate, entry, *keys, white_box=white_box)


def _beside_table(found: Findings, scores: Scores, paper: PaperTable) -> Table:
    """Averages of ours and of the paper's rows, side by side."""
    blocks, entries = paper.table.blocks, found.study.entries
    names = {NORMAL: "Normal", RANDOM: "Random", **{v.key: v.paper_row for v in found.variants}}
    rows = []
    for row, title in found.titles.items():
        ours = [_cell(found, scores, row, entry, found.detectors) for entry in entries]
        rows.append(Row(title, (*ours, *(_printed(block, names[row], paper.number) for block in blocks))))
    columns = [
        *(Column(weathers_title(entry.weathers), "measured here") for entry in entries),
        *(Column(block.title or "its views", f"the paper's Table {paper.number}") for block in blocks),
    ]
    caption = (
        "AP@0.5 averaged over detectors: ours over those whose mean decides, the paper's over its own. Compare the "
        "order and the gaps, not the digits."
    )
    key = f"beside-{found.experiment.name}"
    return Table(key, "Beside the paper", caption, tuple(columns), (Block("", tuple(rows)),))


def _printed(block: Block, name: str | None, table: int) -> Cell | None:
    """The paper's average in a row of that name; None where it printed none."""
    row = next((row.cells[-1] for row in block.rows if row.name == name), None)
    return None if row is None else Cell(row.value, source=Source(f"the paper, Table {table}", (str(name), AVERAGE)))


def _gaps(found: Findings, verdicts: Sequence[Verdict]) -> Table:
    """What decides the verdicts: a row per pair, its gap over all views and those of parts."""
    comparisons = [(verdict, one) for verdict in verdicts for one in verdict.comparisons]
    scopes = unique(scope for _, one in comparisons for scope in one.by_scope)
    entries = found.study.entries

    def cell(gap: Estimate | None, scope: str = "") -> Cell | None:
        """A gap leads to the results that it is computed from, if they are of one set of weathers."""
        of = [entry for entry in entries if len(entries) == 1 or entry.weathers == scope]
        if gap is None:
            return None
        return sourced(gap, of[0], "table") if of else Cell(gap.ap, gap.low, gap.high)

    rows = []
    for verdict, one in comparisons:
        gaps = [cell(one.gap), *(cell(one.by_scope.get(scope), scope) for scope in scopes)]
        told = Cell(found.titles[one.worse]), *gaps, Cell(one.chance), Cell(one.outcome), Cell(verdict.claim.by)
        rows.append(Row(found.titles[one.better], told))
    names = ["gap, all views", *(f"gap, {scope}" for scope in scopes)]
    columns = (
        Column("higher AP claimed", kind="text"),
        *(Column(name, kind="change") for name in names),
        Column("p, corrected", kind="chance"),
        *(Column(name, kind="text") for name in ("outcome", "claim of")),
    )
    return listing("gaps", "lower AP claimed", columns, tuple(rows), "Orderings")


def _pictures(found: Findings) -> dict[str, Any]:
    """A row per camouflage: its UV map, and the frames that the report's rule picks, with what a detector found."""
    picker, entries = FramePicker(found.study.entries), found.study.entries
    detector = (found.white_box or found.detectors)[0]
    grid, jpegs = picker.grid(detector), {record.name: jpeg for record, jpeg in maps_of(entries)}
    rows = {
        found.titles_of_paints[paint]: [
            Picture(jpegs[paint], f"UV map of {paint}") if paint in jpegs else None,
            *pictures,
        ]
        for paint, pictures in grid.rows.items()
    }
    return {"picker": picker, "detector": detector, "grid": Grid(["UV map", *grid.titles], rows)}


def _settings(found: Findings) -> Table | None:
    rows = [Row(found.titles[key], (Cell(_told(settings) or "–"),)) for key, settings in found.settings.items()]
    return listing("settings", "variant", (Column("settings of its own", kind="text"),), tuple(rows)) if rows else None


def _told(settings: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{name} ({_told(value)})" if isinstance(value, Mapping) else f"{name} {value}"
        for name, value in settings.items()
    )


def _about(found: Findings, verdicts: Sequence[Verdict]) -> dict[str, Any]:
    return {
        "experiment": found.experiment.name,
        "detectors_that_decide": found.detectors,
        "attacked": list(found.attacked),
        "paints": {row: list(paints) for row, paints in found.paints.items()},
        "verdicts": [
            {"by": verdict.claim.by, "outcome": verdict.outcome, "sentence": verdict.sentence(found.titles)}
            for verdict in verdicts
        ],
        "common": dict(found.common),
        "settings": {row: dict(settings) for row, settings in found.settings.items()},
        "timings_s": dict(found.timings_s),
    }
