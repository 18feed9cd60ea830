"""The tables of an assessment: by paint, causes of mistakes, weak spots, defences, and what changed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from ..study.assess import FILE_NAME, WHITE_BOX
from ..study.assessment import Assessment, Score
from ..study.assessment_change import Change
from ..study.candidates import NORMAL, RANDOM
from ..study.defences import NO_DEFENCE
from ..study.mistakes import Mistakes
from ..study.recall import Around, Recall, side_of
from ..study.weak_spots import Range
from .study_tables import defence_title
from .table import Block, Cell, Column, Row, Source, Table, listing

TRANSFER = "transfer, mean"
PAINTS = {"clean": NORMAL, "random": RANDOM, "transfer": TRANSFER, "white_box": WHITE_BOX}
"""The figures of an assessment that say most, and how tables call the paint."""
KINDS = {"clean": "plain", "random": "random", "transfer": "transfer", "white_box": "white box"}
"""What people call them."""


def score_cell(score: Score | None, *keys: str, file: str = FILE_NAME) -> Cell | None:
    """AP@0.5 with its interval, which stands in the assessment under ``keys``."""
    return None if score is None else Cell(score.ap, score.low, score.high, Source(file, (*keys, "ap")))


def paints_of(found: Assessment) -> dict[str, tuple[Score, tuple[str, ...]]]:
    """The score of every paint, and where it stands; the mean of the library after the library's own."""
    told: dict[str, tuple[Score, tuple[str, ...]]]
    told = {NORMAL: (found.clean, ("clean",)), RANDOM: (found.random, ("random",))}
    told |= {name: (one, ("transfer_by_camouflage", name)) for name, one in found.transfer_by_camouflage.items()}
    told[TRANSFER] = (found.transfer, ("transfer",))
    if found.white_box is not None:
        told[WHITE_BOX] = (found.white_box, ("white_box",))
    return told


def shown_range(found: Range) -> str:
    """A range as people read it."""
    if found.never:
        return f"less than {found.metres:g} m"
    return f"{found.metres:g} m or more" if found.beyond else f"{found.metres:.1f} m"


def paints_table(found: Assessment) -> Table:
    """AP@0.5 with its interval, recall and range of every paint."""
    columns = (
        Column("AP@0.5"), Column("recall", kind="share"), Column("found up to", kind="text"),
        Column("what it is", kind="text"),
    )  # fmt: skip
    rows = []
    for name, (score, keys) in paints_of(found).items():
        reach = found.range_m.get(name)
        recall = Cell(score.recall, source=Source(FILE_NAME, (*keys, "recall")))
        told = None if reach is None else Cell(shown_range(reach))
        rows.append(Row(name, (score_cell(score, *keys), recall, told, Cell(_about(name, found)))))
    return listing("paints", "paint", columns, tuple(rows), "By paint")


def _about(paint: str, found: Assessment) -> str:
    known = {
        NORMAL: "the vehicles' own paint",
        RANDOM: "cells of random colors: what any bold pattern does",
        TRANSFER: "mean of the camouflages made for other detectors",
        WHITE_BOX: "made against this very detector, in this assessment",
    }
    left = "of the library, but made against this very detector: not in the mean"
    return known.get(paint) or (left if paint in found.left_out else "of the library, made for other detectors")


def errors_table(found: Assessment) -> Table:
    """Each wrong thing under its one cause; causes sum to what is wrong."""
    causes = [one.name for one in fields(Mistakes)]
    columns = (*(Column(name.replace("_", " "), kind="count") for name in causes), Column("wrong, all", kind="count"))

    def cells(paint: str, counted: Mistakes) -> tuple[Cell, ...]:
        told = (Cell(getattr(counted, name), source=Source(FILE_NAME, ("errors", paint, name))) for name in causes)
        return (*told, Cell(counted.wrong, source=Source(FILE_NAME, ("errors", paint))))

    rows = tuple(Row(paint, cells(paint, counted)) for paint, counted in found.errors.items())
    return listing("errors", "paint", columns, rows, "What is wrong")


def weak_spots_table(found: Assessment) -> Table:
    """The worst cell and the worst tenth of every paint."""
    cell, tenth = "worst side, distance and weather", "worst tenth of the views"
    columns = (
        Column("where", cell, kind="text"), Column("found there", cell, kind="text"), Column("mean score", cell),
        Column("mean score", tenth), Column("recall", tenth, kind="share"),
    )  # fmt: skip
    rows = []
    for paint, worst in found.worst_cell.items():
        lowest = found.worst_tenth[paint]
        told = (
            Cell(where(worst.azimuth_deg, worst.distance_m, worst.weather)),
            Cell(count_of(worst.recall, len(worst.frames))),
            Cell(worst.score, source=Source(FILE_NAME, ("worst_cell", paint, "score"))),
            Cell(lowest.score, source=Source(FILE_NAME, ("worst_tenth", paint, "score"))),
            Cell(lowest.recall, source=Source(FILE_NAME, ("worst_tenth", paint, "recall"))),
        )
        rows.append(Row(paint, told))
    return listing("weak-spots", "paint", columns, tuple(rows), "Weak spots")


def where(azimuth_deg: float, distance_m: float, weather: str) -> str:
    """A view in words."""
    return f"{side_of(azimuth_deg)}, {distance_m:g} m, {weather}"


def count_of(share: float, views: int) -> str:
    """A share of few views as what it is: a count."""
    return f"{round(share * views)} of {views}"


def defences_table(found: Assessment) -> Table | None:
    """The same scores through each defence; None where none was looked through."""
    if not found.defences:
        return None
    names = ("white box, unaware", "white box, informed")
    columns = (*(Column(name) for name in ("plain", "random", "transfer", *names)), Column("attack", kind="text"))
    kept = tuple(score_cell(getattr(found, kind), kind) for kind in KINDS)
    rows = [Row(defence_title(NO_DEFENCE), (*kept, None, None))]
    for name, one in found.defences.items():
        scores = ((kind, getattr(one, kind)) for kind in (*KINDS, "informed"))
        cells = (score_cell(score, "defences", name, kind) for kind, score in scores)
        rows.append(Row(defence_title(name), (*cells, Cell("failed") if one.attack_failed else None)))
    return listing("defences", "defence", columns, tuple(rows), "Defences")


def changes_table(found: Sequence[Change]) -> Table:
    """AP@0.5 before and after, with the paired interval of the difference."""
    columns = (Column("before"), Column("after"), Column("change", kind="change"), Column("beyond chance", kind="text"))
    rows = []
    for one in found:
        verdict = ("yes, better" if one.difference > 0 else "yes, worse") if one.beyond_chance else "no"
        verdict = verdict if one.decided else "undecided: one attack each"
        told = (Cell(one.before), Cell(one.after), Cell(one.difference, one.low, one.high), Cell(verdict))
        rows.append(Row(PAINTS[one.paint], told))
    return listing("changes", "paint", columns, tuple(rows), "What changed")


def distance_table(along: Mapping[str, Mapping[float, Recall]]) -> Table:
    """Recall of some paints at each distance, as a curve."""
    distances = list(next(iter(along.values())))
    columns = tuple(Column(f"{distance:g}", kind="share") for distance in distances)
    rows = tuple(
        Row(paint, tuple(Cell(one.share, one.low, one.high) for one in recall.values()))
        for paint, recall in along.items()
    )
    views = [one.views for one in next(iter(along.values())).values()]
    caption = f"Share of views in which the vehicle is found; {_span(views)} views at each distance."
    return Table("distance", "Distance (m)", caption, columns, (Block("", rows),), ranked=False, corner="paint")


def around_table(paint: str, views: Around) -> Table:
    """In how many of how many views from each side and distance the vehicle is found."""

    def cell(found: Any, of: Any) -> Cell | None:
        return Cell(f"{found} of {of}") if of else None

    rows = tuple(
        Row(band, tuple(map(cell, found, of)))
        for band, found, of in zip(views.bands, views.found, views.views, strict=True)
    )
    columns = tuple(Column(side, kind="text") for side in views.sides)
    return listing(f"around-{paint}", "distance", columns, rows, f"Found in {paint}")


def _span(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return f"{low}" if low == high else f"{low} to {high}"
