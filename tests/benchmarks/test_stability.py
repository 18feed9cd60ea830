"""The catalogue of hard cases: every one comes out as it must, and one that does not is told."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from benchmarks.stability import DTYPES, Check, bench, expect, name_of, outcome
from benchmarks.stability.bench import FAST, QUICK, catalogue
from benchmarks.stability.optimizer import CASES, Endured, judge

torch.set_num_threads(1)


@pytest.mark.parametrize("dtype", DTYPES, ids=name_of)
@pytest.mark.parametrize("check", FAST, ids=lambda check: f"{check.part}: {check.name}")
def test_hard_case(check: Check, dtype: torch.dtype) -> None:
    found = outcome(check, dtype)
    assert found.holds is not False, f"{check.expected}: {found.happened}"


def test_every_part_and_every_case_of_the_optimizer_is_listed_once() -> None:
    listed = catalogue(1)
    assert list(dict.fromkeys(c.part for c in listed)) == [
        "rasterizer", "renderer", "environment", "losses", "optimizer",
    ]  # fmt: skip
    assert len({(c.part, c.name) for c in listed}) == len(listed)
    assert sum(c.part == "optimizer" for c in listed) == len(CASES)
    assert all(torch.float32 not in c.pointless for c in listed)


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [
        ({"finite": False}, "not finite"),
        ({"in_range": False}, "outside"),
        ({"stray": 3}, "3 texels"),
        ({"moved": 0.2}, "20.0% moved"),
        ({"learnt": 0.0, "moved": 0.0}, "0.0% of the texels"),
    ],
)
def test_a_run_that_goes_wrong_is_judged_so(spoilt: dict[str, float], said: str) -> None:
    fine = Endured(5, True, True, 1.0, 1.0, 0, 0.1)
    assert "100% of the paint moves" in judge(CASES[0], fine)
    with pytest.raises(AssertionError, match=said):
        judge(CASES[0], replace(fine, **spoilt))


def test_the_table_tells_what_failed_what_broke_and_what_has_no_meaning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fails_in_half(dtype: torch.dtype) -> str:
        expect(dtype != torch.bfloat16, "off by 3")
        return "exact"

    def breaks(dtype: torch.dtype) -> str:
        raise ZeroDivisionError("by nought")

    checks = (
        Check("losses", "one", "exact", fails_in_half, {torch.float64: "never double"}),
        Check("losses", "two", "whole", breaks),
    )
    monkeypatch.setattr(bench, "catalogue", lambda steps: checks)
    results = bench.bench(tmp_path / "out.json", QUICK, tmp_path)
    assert [target.found for target in results.targets] == [4]
    cases = json.loads((tmp_path / "out.json").read_text())["cases"]
    assert cases[0]["float32"] == {"as_expected": True, "happened": "exact"}
    assert cases[0]["bfloat16"] == {"as_expected": False, "happened": "UnexpectedError: off by 3"}
    assert cases[0]["float64"] == {"as_expected": None, "happened": "never double"}
    assert "| bfloat16 | 0 | 2 | 0 |" in (tmp_path / "reliability.md").read_text()
    said = capsys.readouterr().out
    assert "off by 3" in said
    assert "by nought" in said
