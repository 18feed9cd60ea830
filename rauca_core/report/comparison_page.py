"""Several detectors under one battery: one table, sorted by AP in camouflages made for others."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..contract import RaucaError
from ..study.assess import FILE_NAME
from ..study.assessment import Assessment
from ..study.assessment_change import change_in, corrected
from ..study.candidates import NORMAL
from .assessment_tables import KINDS, score_cell, shown_range
from .figures import GREY, OCHRE, PALETTE, Style, intervals_svg
from .page import Behind, write_page
from .table import Cell, Column, Row, Source, Table, listing

STYLES = dict(
    zip(
        KINDS.values(),
        (Style(*GREY, "o"), Style(*OCHRE, "s"), Style(*PALETTE[0], "^"), Style(*PALETTE[1], "D")),
        strict=True,
    )
)
_LIMITS = (
    "Transfer is the mean over camouflages that were not made against the detector itself: where some were, the "
    "mean is over fewer. Each detector's own page says which.",
    "The white box is one attack of a given length on each detector: an upper bound of its robustness. Where it is "
    "missing, the detector could not be attacked, which does not make it robust.",
)


def write_comparison(found: Sequence[Assessment], out: Path, pages: Sequence[Path] = ()) -> list[Path]:
    """Write the page to ``out`` (.html), and its numbers (.csv, .json, .tex) beside it; returns all, the page first.

    Args:
        found: at least one.
        pages: of each detector, to link to; none if left out.

    Raises:
        RaucaError: there is none, or they are of different batteries, budgets or vehicles; nothing was written.
    """
    table, first = comparison_table(found), found[0]
    told = {
        "title": "How robust are these detectors?",
        "scope": f"Battery {first.battery}, budget {first.budget}: {first.clean.frames} views of "
        f"{' and '.join(first.vehicles)}, the same for every detector.",
        "lead": [_lead(found)],
        "styles": STYLES,
        "table": table,
        "pages": [
            (one.detector.name, Source(page, ()).told(out.parent)) for one, page in zip(found, pages, strict=False)
        ],
        "drawing": intervals_svg(table, STYLES),
    }
    behind = Behind(settings={"deployed scores": _thresholds(found)}, limits=_LIMITS, fewest=first.clean.frames)
    about = {"battery": first.battery, "budget": first.budget, "detectors": [one.detector.to_json() for one in found]}
    return write_page(out, "comparison.html", told, [table], about, behind)


def comparison_table(found: Sequence[Assessment]) -> Table:
    """A row per detector, the best under transfer first; errors as of :func:`write_comparison`."""
    if not found:
        raise RaucaError("comparison: no assessment was given")
    for name in ("battery", "budget", "vehicles"):
        if len(kinds := {str(getattr(one, name)): one.detector.name for one in found}) > 1:
            told = ", ".join(f"{kind} of {detector}" for kind, detector in kinds.items())
            raise RaucaError(f"comparison: assessments of different {name} ({told}); assess all on the same")
    ranked = _ranked(found)
    columns = (
        *(Column(title) for title in KINDS.values()), Column("less the first's transfer", kind="change"),
        Column("worst tenth's score"), Column("plain", "found up to", kind="text"),
        Column("worst camouflage", "found up to", kind="text"), Column("ms an image", kind="number"),
    )  # fmt: skip
    rows = tuple(_row(one, ranked[0]) for one in ranked)
    return listing("comparison", "detector", columns, rows, "Detectors under one battery")


def _lead(found: Sequence[Assessment]) -> str:
    """Who is best under transfer, and who can be told from it."""
    best, *others = _ranked(found)
    told = corrected([change_in("transfer", best, one) for one in others])
    behind = [one.detector.name for one, less in zip(others, told, strict=True) if less.beyond_chance]
    level = [one.detector.name for one in others if one.detector.name not in behind]
    parts = [f"In camouflages made for other detectors AP@0.5 is highest for {best.detector.name}"]
    parts += [f"beyond chance below it: {', '.join(behind)}"] if behind else []
    parts += [f"not to be told from it: {', '.join(level)}"] if level else []
    return f"{'; '.join(parts)}."


def _ranked(found: Sequence[Assessment]) -> list[Assessment]:
    """The best under transfer first."""
    return sorted(found, key=lambda one: -one.transfer.ap)


def _row(one: Assessment, first: Assessment) -> Row:
    name = one.detector.name
    file = f"{FILE_NAME} of {name}"
    scores = (score_cell(getattr(one, kind), kind, file=file) for kind in KINDS)
    behind = change_in("transfer", first, one)
    less = None if one is first else Cell(behind.difference, behind.low, behind.high)
    tenth = Cell(one.worst_tenth[NORMAL].score, source=Source(file, ("worst_tenth", NORMAL, "score")))
    reach = (Cell(shown_range(one.range_m[paint])) for paint in (NORMAL, one.worst_camouflage))
    return Row(name, (*scores, less, tenth, *reach, Cell(one.detector.ms_per_image)))


def _thresholds(found: Sequence[Assessment]) -> str:
    return ", ".join(f"{one.detector.name} {one.threshold:g}" for one in found)
