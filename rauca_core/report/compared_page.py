"""Rows of finished studies held against each other, as one page: who judged, in which places, and by how many seeds."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..study.ablations.findings import Comparison, Verdict
from ..study.compare import Compared
from ..study.detectors import in_table_order
from ..study.intervals import SEEDS_NEEDED
from ..study.parts import PARTS
from ..study.results import Estimate
from ..study.study import Study
from .figures import GREY, OCHRE, PALETTE, Style, intervals_svg
from .page import write_study_page
from .published import published_means
from .study_tables import detector_columns
from .table import Block, Cell, Column, Row, Table, listing, printed

STYLES = dict(zip(PARTS, (Style(*PALETTE[0], "o"), Style(*OCHRE, "s"), Style(*GREY, "^")), strict=True))
_LIMIT = (
    "Rows of one seed say nothing of the luck of an optimization. Each interval is for itself; only verdicts are "
    "corrected for how many rows there are."
)


def write_compared(found: Compared, out: Path, command: str = "", verdicts: Sequence[Verdict] = ()) -> list[Path]:
    """Write ``out`` (.html) and its numbers (.csv, .json, .tex) beside it.

    Args:
        command: what was typed.
        verdicts: on a row that is claimed to be below all others (:meth:`Compared.verdicts`); no claim if left out.

    Returns:
        What was written, the page first.

    Raises:
        RaucaError: detections of a study are missing; then nothing was written.
    """
    parts, every, ranks = table_by_part(found), _by_detector(found), _ranks(found)
    gaps = _gaps([one for verdict in verdicts for one in verdict.comparisons])
    told = {
        "title": "Camouflages compared",
        "scope": f"{sum(found.scores.frames.values())} views of {found.places} in the {found.use} town {found.town}.",
        "lead": _lead(found),
        "marks": STYLES,
        "found": found,
        "seeds_needed": SEEDS_NEEDED,
        "parts_table": parts,
        "drawing": intervals_svg(parts, STYLES),
        "every": every,
        "gaps": gaps,
        "ranks": ranks,
    }
    tables = [table for table in (parts, every, gaps, ranks) if table is not None]
    about = {
        "town": found.town,
        "use": found.use,
        "judges": found.judges,
        "relatives": found.relatives,
        "attacked": {row: sorted(names) for row, names in found.attacked.items()},
        "paints": {row: list(paints) for row, paints in found.rows.items()},
    }
    study = Study(command, found.entries)
    return write_study_page(study, out, "compared.html", told, tables, about, {}, limits=[_LIMIT])


def _lead(found: Compared) -> list[str]:
    """Every row's mean over the detectors that took no part, the lowest first."""
    if not found.judges:
        return ["Every detector here was attacked by some row, or is of an attacked one's family."]
    means = {row: found.ap(row, found.judges).ap for row in found.rows}
    told = ", ".join(f"{row} {printed(means[row])}" for row in sorted(means, key=lambda row: means[row]))
    return [f"AP@0.5, mean over {len(found.judges)} detectors that took no part: {told}."]


def table_by_part(found: Compared) -> Table:
    """A row's mean over the detectors that took no part, over their relatives and over the attacked ones."""
    means = {row: found.by_part(row).values() for row in found.rows}
    rows = [Row(row, tuple(None if one is None else _cell(one) for one in some)) for row, some in means.items()]
    told = ", ".join(found.judges) or "no detector"
    caption = f"AP@0.5, mean over all views and seeds. Took no part in any row's attack: {told}."
    return Table("parts", "By part in the attack", caption, tuple(map(Column, PARTS)), (Block("", tuple(rows)),))


def _by_detector(found: Compared) -> Table:
    """AP of every row and detector, over all views and under each set of them."""
    names = in_table_order(list(found.scores.detectors))
    sets = {"all views": found.scores.weathers, **{name: (name,) for name in found.scores.weathers}}
    blocks = []
    for title, weathers in list(sets.items())[len(found.scores.weathers) == 1 :]:
        rows = [
            Row(row, tuple(_cell(found.ap(row, [name], weathers), name in found.attacked[row]) for name in names))
            for row in found.rows
        ]
        blocks.append(Block(title, tuple(rows)))
    attacked = [name for some in found.attacked.values() for name in some]
    caption = f"{found.entries[0].category.capitalize()} AP@0.5, mean over seeds."
    return Table("detectors", "By detector", caption, detector_columns(names, attacked), tuple(blocks))


def _gaps(comparisons: Sequence[Comparison]) -> Table | None:
    """What decides whether a row is below the others, a row each."""
    if not comparisons:
        return None
    lowest = comparisons[0].better
    columns = (
        Column(f"AP less that of {lowest}", kind="change"),
        Column("seeds", kind="count"),
        Column("p, corrected", kind="chance"),
        Column("outcome", kind="text"),
    )
    rows = [
        Row(one.worse, (_cell(one.gap), Cell(one.seeds), Cell(one.chance), Cell(one.outcome))) for one in comparisons
    ]
    return listing("gaps", "row", columns, tuple(rows), f"Is {lowest} below the others?")


def _ranks(found: Compared) -> Table | None:
    """Whether others found the same order."""
    rows = []
    for title, means in published_means().items():
        correlation = found.rank_correlation(means)
        if correlation is not None:
            rows.append(Row(title, (Cell(correlation[0]), Cell(correlation[1]))))
    columns = Column("Spearman's correlation", kind="chance"), Column("rows in common", kind="count")
    return listing("ranks", "published order", columns, tuple(rows), "The order that others found") if rows else None


def _cell(estimate: Estimate, white_box: bool = False) -> Cell:
    return Cell(estimate.ap, estimate.low, estimate.high, white_box=white_box)
