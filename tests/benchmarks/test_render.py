"""The renderer's benchmark, on tiny settings: its figures are all there, finite, and in the order that must hold."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness import Results, Row
from benchmarks.in_blender import open_vehicle
from benchmarks.render import FULL, bench
from benchmarks.render_contenders import ALGORITHM_2, BILINEAR
from benchmarks.render_reference import RINGS, TEXTURES, RayCaster, ring
from rauca_core.contract import RaucaError, Vehicle

pytest.importorskip("embreex", reason="Embree is not installed (rauca[bench])")

TINY = FULL.but(
    sizes=(128,),
    uv_size=256,
    views={"paper": 2, "close": 1},
    reach_views=2,
    samples=(1, 2, 4, 8),
    repeats=1,
    steps=1,
    cameras=2,
    camera_size=64,
    mask_samples=64,
    color_samples=16,
    color_views=1,
)


@pytest.fixture(scope="module")
def sedan() -> Vehicle:
    return open_vehicle("sedan")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="module")
def results(folder: Path) -> Results:
    pytest.importorskip("bpy", reason="Blender as a module is not installed")
    return bench(folder / "render.json", TINY, folder / "docs")


def find(results: Results, name: str, texture: str, ring_name: str = "paper") -> Row:
    return results.one("renderers", name=name, texture=texture, ring=ring_name)


def test_every_renderer_meets_every_ring_and_texture_with_finite_figures(results: Results, folder: Path) -> None:
    told = (folder / "render.json").read_text()
    assert "null" not in told  # what infinity and NaN become
    report = json.loads(told)
    assert all(report[key] > 0 for key in ("speedup_vs_algorithm2", "raster_vs_embree"))
    met = {(e["name"], e["ring"], e["texture"]) for e in report["renderers"]}
    names = {name for name, _, _ in met}
    assert {BILINEAR, ALGORITHM_2, "1 trilinear sample", "Algorithm 1, 2x2", "ours 1x1", "ours 8x8"} <= names
    assert met == {(name, r, t) for name in names for r in RINGS for t in TEXTURES}


@pytest.mark.parametrize("ring_name", RINGS)
@pytest.mark.parametrize("texture", TEXTURES)
def test_more_samples_and_better_samplers_err_less(results: Results, ring_name: str, texture: str) -> None:
    db = {name: find(results, name, texture, ring_name)["psnr_db"] for name in results.distinct("renderers", "name")}
    ours = [db[f"ours {n}x{n}"] for n in TINY.samples]
    assert ours == sorted(ours)
    assert ours[-1] > ours[0] + 10
    assert db["ours 4x4"] > max(db[BILINEAR], db[ALGORITHM_2]) + 5


def test_rings_of_views_reach_texels_that_one_bilinear_sample_misses(results: Results) -> None:
    ours, bilinear = (find(results, name, "noise")["reached"] for name in ("ours 4x4", BILINEAR))
    assert 0.95 < ours <= 1
    assert bilinear < 0.5 * ours


def test_embree_and_blender_agree_and_all_targets_are_told(results: Results) -> None:
    assert all(row["same_face"] > 0.99 for row in results.rows["raster"])
    (row,) = results.rows["blender"]
    assert row["cameras"] == TINY.cameras
    assert row["iou_mean"]["8"] > 0.95  # cars of a few hundred pixels
    assert row["uv_median"] < 0.05
    assert row["uv_p99"] < 0.5
    assert row["edge_db"] > 20
    assert len(results.targets) == 18


def test_pictures_are_small(results: Results, folder: Path) -> None:
    files = list((folder / "docs" / "pictures" / "renderer").iterdir())
    wanted = {"speed-error.svg", "reference.jpg", "ours-4x4.jpg", "algorithm-2-2x2.jpg"}
    assert wanted <= {f.name for f in files}
    assert sum(f.stat().st_size for f in files) < 2**20
    assert "| ours 4x4 |" in (folder / "docs" / "renderer.md").read_text()


def test_rings_see_what_they_say(sedan: Vehicle) -> None:
    shares = []
    for name in RINGS:
        cameras = ring(sedan, name, 4, 64)
        boxes = [np.ptp(c.project(sedan.positions.astype(float))[0], axis=0) for c in cameras]
        shares.append(np.mean([b.max() / 64 for b in boxes]))
    paper, close = shares
    assert paper < 0.5 < 0.7 < close


def test_without_embree_one_line_says_what_to_install(sedan: Vehicle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(RaucaError, match=r"pip install rauca\[bench\]"):
        RayCaster(sedan)
