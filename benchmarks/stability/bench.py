"""``rauca bench stability``: every hard case in three precisions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch

from benchmarks.harness import Results, Row, Settings, counted
from rauca_core.runtime.devices import threads

from . import DTYPES, Check, Outcome, light, losses, name_of, optimizer, outcome, rasterizer, renderer

FULL = Settings(steps=100)  # of each case of the optimizer
QUICK = FULL.but(steps=25)

FAST: tuple[Check, ...] = (*rasterizer.CHECKS, *renderer.CHECKS, *light.CHECKS, *losses.CHECKS)
Found = Mapping[torch.dtype, Outcome]


def catalogue(steps: int) -> tuple[Check, ...]:
    """All hard cases, by the part they are hard for; the optimizer's take ``steps`` steps each."""
    return (*FAST, *optimizer.checks(steps))


def bench(out: Path, settings: Settings, docs: Path | None = None) -> Results:
    """Try all; a case that fails is a missed target."""
    checks, found = catalogue(settings.steps), list[Found]()
    with threads(1), counted("hard cases", len(checks)) as moved:
        for check in checks:
            found.append({dtype: outcome(check, dtype) for dtype in DTYPES})
            moved(check.name)
    results = Results("stability", settings)
    shown: dict[str, list[Row]] = {}
    for check, each in zip(checks, found, strict=True):
        told = {name_of(dtype): {"as_expected": o.holds, "happened": o.happened} for dtype, o in each.items()}
        results.add("cases", part=check.part, case=check.name, expected=check.expected, **told)
        cells = {name_of(dtype): _cell(o) for dtype, o in each.items()}
        shown.setdefault(check.part, []).append({"case": check.name, "expected": check.expected, **cells})
    answers = {dtype: [each[dtype].holds for each in found] for dtype in DTYPES}
    rows = [
        {"precision": name_of(dtype), "yes": holds.count(True), "no": holds.count(False), "none": holds.count(None)}
        for dtype, holds in answers.items()
    ]
    columns = {"precision": "{precision}", "as expected": "{yes}", "otherwise": "{no}", "without meaning": "{none}"}
    results.table(f"{len(checks)} hard cases", columns, rows)
    columns = {name: f"{{{name}}}" for name in ("case", "expected", *map(name_of, DTYPES))}
    for part, cases in shown.items():
        results.table(part.capitalize(), columns, cases, on_page=False)
    failed = sum(holds.count(False) for holds in answers.values())
    results.target("cases that come out otherwise than they must", 0, failed, most=True)
    results.publish(out, docs, "reliability.md", width=200)
    return results


def _cell(found: Outcome) -> str:
    if found.holds is None:
        return f"n/a: {found.happened}"
    return found.happened if found.holds else f"**FAILS**: {found.happened}"
