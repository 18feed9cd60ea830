"""How well detectors find a vehicle, from what an evaluation or an assessment wrote; no bpy in here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

from ...core import contract, schema
from .evaluation import NORMAL, STUDY, STUDY_FORMAT

ASSESSED = "assess.json"
PAINTS = ("clean", "random", "transfer", "white_box")  # of an assessment


@dataclass(frozen=True)
class Found:
    """AP@0.5 in [0, 1] by what the vehicle wore: 1 is always found and placed well, 0 never.

    Attributes:
        by: a detector's name, or the part that several had in the attacks, as `study.json` calls it.
        mean: of the detectors that had that part; detectors of different parts are never averaged together.
    """

    by: str
    worn: Mapping[str, float]
    mean: bool = False


def read_found(folder: Path) -> list[Found]:
    """The table of a folder: assessments of one or several detectors, or else an evaluation, its means first.

    Raises:
        RaucaError: there is neither, or it is damaged.
    """
    assessed = [folder / ASSESSED] if (folder / ASSESSED).is_file() else sorted(folder.glob(f"*/{ASSESSED}"))
    if assessed:
        return [_assessment(path) for path in assessed]
    study = schema.read_json(folder / STUDY)
    study.format(*STUDY_FORMAT)
    rows = [row for row in study.objects("entries") if row.text("defence") == "none"]
    if not rows:
        raise contract.RaucaError("No results without a defence; evaluate again")
    parts = rows[0].nested("parts")
    together = {part: parts.texts(part) for part in parts.names()}
    return _over_weathers([schema.read_json(folder / row.text("results")).nested("table") for row in rows], together)


def _assessment(path: Path) -> Found:
    fields = schema.read_json(path)
    fields.format("rauca-assessment", 1)
    worn = {paint: fields.nested(paint).number("ap", 0.0, 1.0) for paint in PAINTS if _is_there(fields, paint)}
    return Found(fields.nested("detector").text("name"), worn)


def _is_there(fields: schema.Fields, paint: str) -> bool:
    return paint != "white_box" or not fields.is_null(paint)


def _over_weathers(tables: list[schema.Fields], parts: Mapping[str, list[str]]) -> list[Found]:
    """Means over sets of weathers, of parts and of detectors; the vehicle's own paint first."""
    paints = [name for name in tables[0].names() if all(table.has(name) for table in tables)]
    ordered = sorted(paints, key=lambda name: name != NORMAL)
    names = tables[0].nested(ordered[0]).names()
    worn = {name: {paint: fmean(_aps(tables, paint, name)) for paint in ordered} for name in names}
    means = [
        Found(part, {paint: fmean(worn[name][paint] for name in some) for paint in ordered}, mean=True)
        for part, some in parts.items()
    ]
    return [*means, *(Found(name, worn[name]) for name in names)]


def _aps(tables: Iterable[schema.Fields], paint: str, detector: str) -> list[float]:
    return [table.nested(paint).nested(detector).number("ap", 0.0, 1.0) for table in tables]
