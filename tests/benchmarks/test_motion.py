"""The motion benchmark's own sums: what a frame costs is told of resumed runs, too."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import motion
from benchmarks.harness import Results


def render(folder: Path, *frames: str) -> None:
    for frame in frames:
        (folder / "store" / "views" / "sedan" / "frames" / frame).mkdir(parents=True)
        painted = folder / "store" / "renders" / "random" / f"{frame}.png"
        painted.parent.mkdir(parents=True, exist_ok=True)
        painted.touch()


def test_a_frames_cost_is_the_mean_over_all_runs_that_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([100.0, 108.0, 50.0, 60.0, 65.0, 0.0, 0.5])  # the run that is stopped reads it once
    monkeypatch.setattr(motion, "children_s", lambda: next(clock))
    folder, told = tmp_path / "study", []

    def run(*frames: str, stopped: bool = False) -> None:
        results = Results("motion", motion.QUICK)
        with motion._measured(results, folder):
            render(folder, *frames)
            if stopped:
                raise KeyboardInterrupt
        told.append(results.figures["clip_cpu_s_per_frame"])

    run("a", "b")  # eight seconds, and each frame is rendered plain and painted
    with pytest.raises(KeyboardInterrupt):
        run("c", stopped=True)
    run("d")  # five seconds
    run()  # a look at what is there
    assert told == pytest.approx([8 / 4, 13 / 6, 13.5 / 6])
    assert json.loads((folder / "cpu.json").read_text()) == {"cpu_s": 13.5, "frames": 6}


def test_the_whole_benchmark_drives_twelve_clips_past_four_detectors() -> None:
    full = motion.FULL
    assert len(full.manoeuvres) * len(full.weathers) == 12
    assert len(full.detectors) == 4
