"""`rauca optimize --json-progress` as another program sees it: its lines, and its pictures."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from benchmarks.stability.drawn import make_dataset
from pipelines.cli import app
from rauca_core.contract import OptimizeProgress, Vehicle, parse_optimize_progress
from rauca_core.runtime.images import read_image
from tests.published import published_weights


@pytest.fixture
def optimize(tmp_path: Path, box_vehicle: Vehicle) -> Callable[..., int]:
    """Makes a small camouflage in ``out``; gives the exit code."""
    published_weights("yolov3-tiny")
    data = make_dataset(tmp_path / "data", box_vehicle, 64, (40.0,))
    small = ["--batch", "1", "--map-size", "32", "--samples", "2", "--threads", "1"]
    small += ["--out", str(tmp_path / "out"), "--detector", "yolov3-tiny", "--json-progress"]
    asked = ["optimize", str(data.folder), *small]
    return lambda *options: CliRunner().invoke(app, [*asked, *options], catch_exceptions=False).exit_code


def test_steps_are_told_line_by_line(
    optimize: Callable[..., int], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert optimize("--steps", "2") == 0
    assert optimize("--steps", "3") == 0
    told = [parse_optimize_progress(line) for line in capfd.readouterr().out.splitlines()]
    assert [(line.step, line.of) for line in told if line] == [(1, 2), (2, 2), (3, 3)]
    last = told[-1]
    assert last is not None
    assert (last.left_s, last.seconds > 0, 0 <= last.score <= 1) == (0.0, True, True)
    assert last.loss == pytest.approx(last.attack + 0.01 * last.smooth)
    assert read_image(Path(last.preview)).shape == (32, 64, 3)
    assert read_image(Path(last.uv_map)).shape == (32, 32, 3)
    assert Path(last.uv_map).parent == tmp_path / "out"


def test_a_reader_that_goes_away_does_not_stop_the_run(optimize: Callable[..., int], tmp_path: Path) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    kept = os.dup(1)
    os.dup2(writer, 1)
    try:
        assert optimize("--steps", "2") == 0
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(writer)
    assert (tmp_path / "out" / "camouflage.json").is_file()


def test_lines_survive_what_else_is_printed() -> None:
    progress = OptimizeProgress(3, 9, 0.5, 0.4, 0.1, 0.3, 0.2, 1.2, "/somewhere/ä b.png", "/somewhere/c.png")
    assert parse_optimize_progress(progress.line()) == progress
    assert parse_optimize_progress(progress.line()[:-1] + ', "later": 1}') == progress
    for other in ("", "optimizing ...", "[1]", '{"step": 1}', "3"):
        assert parse_optimize_progress(other) is None
