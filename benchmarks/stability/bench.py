"""The order of events of ``rauca bench stability``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from benchmarks.page import fill_page
from benchmarks.tables import Grid, markdown_tables, print_tables
from pipelines.console import progress_bar
from rauca_core.contract import Progress
from rauca_core.contract.files import write_json
from rauca_core.runtime.cpu import threads

from .catalogue import catalogue
from .checks import DTYPES, Check, Outcome, name_of, outcome

STEPS, QUICK_STEPS = 100, 10
WIDTH = 200
Found = Mapping[torch.dtype, Outcome]


def bench_stability(out: Path, quick: bool = False, docs: Path | None = None) -> bool:
    """Try every hard case in every precision and write ``out`` (JSON).

    Args:
        docs: folder whose `stability.md` gets the tables anew.

    Returns:
        True if all came out as they must.
    """
    checks = catalogue(QUICK_STEPS if quick else STEPS)
    found: list[Found] = []
    with threads(1), progress_bar("hard cases", resumes=False) as move:
        for check in checks:
            move(Progress(len(found), len(checks), check.name))
            found.append({dtype: outcome(check, dtype) for dtype in DTYPES})
    grids = _tables(checks, found)
    print_tables(grids, WIDTH)
    write_json(out, {"cases": [_as_json(check, each) for check, each in zip(checks, found, strict=True)]})
    if docs is not None:
        fill_page(docs / "stability.md", markdown_tables(grids), "stability")
    return all(o.holds is not False for each in found for o in each.values())


def _as_json(check: Check, found: Found) -> dict[str, Any]:
    told = {name_of(dtype): {"as_expected": o.holds, "happened": o.happened} for dtype, o in found.items()}
    return {"part": check.part, "case": check.name, "expected": check.expected, **told}


def _tables(checks: tuple[Check, ...], found: list[Found]) -> list[Grid]:
    headers = ("case", "expected", *(name_of(dtype) for dtype in DTYPES))
    parts = dict.fromkeys(check.part for check in checks)
    grids: list[Grid] = []
    for part in parts:
        pairs = [(check, each) for check, each in zip(checks, found, strict=True) if check.part == part]
        rows = [(check.name, check.expected, *(_cell(each[dtype]) for dtype in DTYPES)) for check, each in pairs]
        grids.append((part.capitalize(), headers, rows))
    return [_summary(checks, found), *grids]


def _summary(checks: tuple[Check, ...], found: list[Found]) -> Grid:
    rows = []
    for dtype in DTYPES:
        holds = [each[dtype].holds for each in found]
        rows.append((name_of(dtype), *(str(holds.count(answer)) for answer in (True, False, None))))
    title = f"{len(checks)} hard cases"
    return title, ("precision", "as expected", "otherwise", "without meaning"), rows


def _cell(found: Outcome) -> str:
    if found.holds is None:
        return f"n/a: {found.happened}"
    return found.happened if found.holds else f"**FAILS**: {found.happened}"
