"""The ledgers line by line."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from ..contract import RaucaError, read_ledger
from ..contract.ledger import MAX_LEDGER_BYTES, STATES, entry_of
from ..contract.reading import parse_json, read_limited
from ..contract.schema import Fields
from .findings import Finding

DROP_LINE = "remove the line; frames in folders are not affected"
GO_ON = "run the same `rauca dataset make` to render it again"


def check_ledgers(folder: Path, planned: Collection[str], present: Collection[str]) -> Iterator[Finding]:
    """Every line is whole, known and true.

    Args:
        planned: ids of all frames of the plan.
        present: ids of the frames that have a folder.
    """
    for path in sorted(Path(folder).glob("ledger*.jsonl")):
        yield from _lines(path, planned)
    try:
        entries = read_ledger(folder)
    except (RaucaError, UnicodeDecodeError):
        return  # the lines told
    for frame, entry in entries.items():
        if entry.state == "done" and frame in planned and frame not in present:
            yield Finding(f"frames/{frame}", "the ledger says done, its folder is gone", GO_ON)
        if entry.state == "occluded" and frame in present:
            yield Finding(f"frames/{frame}", "the ledger says occluded, yet its folder is there", "remove the folder")


def _lines(path: Path, planned: Collection[str]) -> Iterator[Finding]:
    *lines, rest = read_limited(path, MAX_LEDGER_BYTES, "a ledger").split(b"\n")
    if rest:
        yield Finding(path.name, "its last line is cut off", "run the same `rauca dataset make` again")
    for number, line in enumerate(lines, 1):
        problem = _problem(line, planned)
        if problem:
            yield Finding(path.name, f"line {number} {problem}", DROP_LINE)


def _problem(line: bytes, planned: Collection[str]) -> str | None:
    try:
        told = Fields(parse_json(line, "ledger"), "ledger")
        state = told.text("state")
        if state not in STATES:
            return f"has the unknown state {state!r}"
        frame = entry_of(told).frame
    except RaucaError:
        return "is damaged"
    return None if frame in planned else f"names {frame!r}, which is no frame of the plan"
