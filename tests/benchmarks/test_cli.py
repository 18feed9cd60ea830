"""`rauca bench` as users type it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest


def rauca(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from pipelines.cli import run; run()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_benchmarks_are_listed_with_their_options() -> None:
    listing = rauca("bench", "--help").stdout
    assert all(name in listing for name in ("render", "agreement", "vehicle"))
    options = rauca("bench", "render", "--help").stdout
    assert all(option in options for option in ("--quick", "--vehicle", "--paint-mask", "--json", "--docs"))


def test_a_mistake_is_one_line_and_writes_nothing(tmp_path: Path) -> None:
    pytest.importorskip("bpy", reason="Blender as a module is not installed")
    out = tmp_path / "render.json"
    refused = rauca("bench", "render", "--vehicle", tmp_path / "no.glb", "--quick", "--json", out)
    assert refused.returncode == 2
    assert refused.stderr.strip().startswith("error: ")
    assert "no.glb: no such vehicle" in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1
    assert not out.exists()
