"""`rauca bench` as users type it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import render, vehicle
from pipelines.bench_commands import load_benchmark
from rauca_core.contract import RaucaError


def rauca(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from pipelines.cli import run; run()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_a_mistake_is_one_line_and_writes_nothing(tmp_path: Path) -> None:
    pytest.importorskip("bpy", reason="Blender as a module is not installed")
    out = tmp_path / "render.json"
    refused = rauca("bench", "render", "--vehicle", tmp_path / "no.glb", "--quick", "--json", out)
    assert refused.returncode == 2
    assert refused.stderr.strip().startswith("error: ")
    assert "no.glb: neither a vehicle folder, nor an .obj" in refused.stderr
    assert len(refused.stderr.strip().splitlines()) == 1
    assert not out.exists()


@pytest.mark.parametrize("name", [None, "sedan", "cube", "assets/vehicles/cube"])
def test_a_vehicle_with_its_own_paint_takes_no_other(tmp_path: Path, name: str | None) -> None:
    with pytest.raises(RaucaError, match=r"are of an \.obj, \.glb or \.blend file; drop them"):
        render.bench(tmp_path / "render.json", render.QUICK, vehicle=name, paint_material="Paint")


def test_a_missing_package_is_not_a_missing_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("benchmarks.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ModuleNotFoundError, match="matplotlib"):
        load_benchmark("render")
    with pytest.raises(RaucaError, match="part of a checkout"):
        load_benchmark("no_such")


def test_an_unknown_detector_is_told_before_the_ring_is_rendered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def render(*_: object) -> None:
        raise AssertionError("rendered")

    monkeypatch.setattr(vehicle, "run_blender", render)
    with pytest.raises(RaucaError, match="nosuch"):
        vehicle.bench(tmp_path / "vehicle.json", ["--vehicle", "sedan"], ["nosuch"])
