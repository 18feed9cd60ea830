"""The data sets' benchmark, on tiny settings: its figures are all there, finite, and in the order that must hold."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.dataset import FULL, KINDS, MAPS, SINGLE, Halves, bench, naive_samples, squared_errors
from benchmarks.harness import Results, Row, psnr_db
from rauca_core.contract.color import linear_to_srgb

TINY = FULL.but(
    size=48,
    views=(26,),
    reference_samples=24,
    single_samples=(1, 4),
    raw_samples=(2,),
    map_samples=(2,),
    thresholds=(0.1,),
    adaptive_samples=4,
    bounces=(),
    fog_densities=(50.0,),
    fog_samples=8,
    sets=(("single", (26,)),),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def results(folder: Path) -> Results:
    pytest.importorskip("bpy", reason="Blender as a module is not installed")
    return bench(folder / "dataset.json", TINY, folder / "docs")


def test_headlines_follow_from_finite_figures(results: Results, folder: Path) -> None:
    told = (folder / "dataset.json").read_text()
    assert "null" not in told  # what infinity and NaN become
    report = json.loads(told)
    rates = report["naive_seconds_per_frame"] / report["default_seconds_per_frame"]
    assert report["speedup_vs_naive"] == pytest.approx(rates)
    assert rates > 0


def test_every_axis_is_measured_in_every_weather_and_more_samples_lower_the_error(results: Results) -> None:
    for kind in KINDS:
        of = {(e["what"], e["axis"], e["samples"]): e["psnr_db"] for e in results.where("entries", kind=kind)}
        wanted = {(SINGLE, "samples"), (SINGLE, "raw"), (MAPS, "samples"), (MAPS, "raw"), (MAPS, "adaptive")}
        assert {key[:2] for key in of} == wanted | ({(MAPS, "fog")} if kind == "foggy" else set())
        assert of[SINGLE, "samples", 4] > of[SINGLE, "samples", 1]
        assert of[MAPS, "samples", 2] > of[MAPS, "raw", 2] + 3


def test_the_page_and_the_plots_are_written(results: Results, folder: Path) -> None:
    page = (folder / "docs" / "speed.md").read_text()
    assert [target.what for target in results.targets if target.what in page] == [t.what for t in results.targets]
    assert any("density 50" in target.what for target in results.targets)
    for name in ("dataset.svg", "dataset-fog.svg", "docs/pictures/datasets/cost-error.svg"):
        assert "<svg" in (folder / name).read_text()


def test_a_references_own_noise_does_not_count() -> None:
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.2, 0.8, (128, 128, 3)).astype(np.float32)
    halves = Halves(*(truth + rng.normal(0, 0.02, truth.shape).astype(np.float32) for _ in range(2)))
    found = (truth + 0.01).astype(np.float32)
    display, linear, paint = squared_errors(found, halves, np.ones(truth.shape[:2], bool))
    exact = float(np.mean((linear_to_srgb(found) - linear_to_srgb(truth)) ** 2))
    assert linear == pytest.approx(1e-4, rel=0.05)
    assert display == pytest.approx(exact, rel=0.1)  # sRGB's curve bends what is left of the noise
    assert paint == pytest.approx(display)
    assert psnr_db([0.01, 0.03]) == pytest.approx(-10 * math.log10(0.02))


def entry(what: str, samples: int, psnr: float) -> Row:
    return {"what": what, "axis": "samples", "samples": samples, "psnr_db": psnr}


@pytest.mark.parametrize(("ours_db", "samples"), [(20.0, 1), (34.0, 4), (35.5, 5), (36.9, 7), (50.0, 8)])
def test_the_rival_has_the_samples_that_give_our_error_rounded_down(ours_db: float, samples: int) -> None:
    rival = [entry(SINGLE, n, db) for n, db in ((1, 30.0), (4, 34.0), (8, 37.0))]
    assert naive_samples([entry(MAPS, 8, ours_db), *rival]) == samples
