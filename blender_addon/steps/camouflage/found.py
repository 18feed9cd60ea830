"""How well detectors find a vehicle, from what an evaluation or an assessment wrote; no bpy in here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

from ...core import contract, schema
from .evaluation import NORMAL, STUDY

ASSESSED = "assess.json"
MEAN = "mean"  # over the detectors
PAINTS = ("clean", "random", "transfer", "white_box")  # of an assessment


@dataclass(frozen=True)
class Found:
    """AP@0.5 in [0, 1] by what the vehicle wore: 1 is always found and placed well, 0 never.

    ``by`` is a detector's name, or :data:`MEAN`.
    """

    by: str
    worn: Mapping[str, float]


def read_found(folder: Path) -> list[Found]:
    """The table of a folder: assessments of one or several detectors, or else an evaluation, its mean first.

    Raises:
        RaucaError: there is neither, or it is damaged.
    """
    assessed = [folder / ASSESSED] if (folder / ASSESSED).is_file() else sorted(folder.glob(f"*/{ASSESSED}"))
    if assessed:
        return [_assessment(path) for path in assessed]
    study = schema.read_json(folder / STUDY)
    study.format("rauca-study", 1)
    files = [row.text("results") for row in study.objects("entries") if row.text("defence") == "none"]
    return _means([schema.read_json(folder / file).nested("table") for file in files])


def _assessment(path: Path) -> Found:
    fields = schema.read_json(path)
    fields.format("rauca-assessment", 1)
    worn = {paint: fields.nested(paint).number("ap", 0.0, 1.0) for paint in PAINTS if _is_there(fields, paint)}
    return Found(fields.nested("detector").text("name"), worn)


def _is_there(fields: schema.Fields, paint: str) -> bool:
    return paint != "white_box" or not fields.is_null(paint)


def _means(tables: list[schema.Fields]) -> list[Found]:
    """Over sets of weathers, the vehicle's own paint first."""
    if not tables:
        raise contract.RaucaError("No results without a defence; evaluate again")
    paints = [name for name in tables[0].names() if all(table.has(name) for table in tables)]
    ordered = sorted(paints, key=lambda name: name != NORMAL)
    names = tables[0].nested(ordered[0]).names()
    return [
        Found(name, {paint: fmean(_aps(tables, paint, name)) for paint in ordered})
        for name in sorted(names, key=lambda name: name != MEAN)
    ]


def _aps(tables: Iterable[schema.Fields], paint: str, detector: str) -> list[float]:
    return [table.nested(paint).nested(detector).number("ap", 0.0, 1.0) for table in tables]
