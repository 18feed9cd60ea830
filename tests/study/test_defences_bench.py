"""The defences' benchmark on a few drawn views: its patch sits where it should, its figures are all there."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image

from benchmarks.defences import FULL, SIDE, bench, paste, patch_area, ready_defences
from rauca_core.contract import RaucaError
from rauca_core.detect import Detector


def test_a_patch_covers_a_quarter_of_the_box_and_nothing_else() -> None:
    images, box = torch.full((1, 3, 100, 120), 0.5), torch.tensor([[20.0, 30.0, 100.0, 70.0]])
    pasted = paste(images, box, torch.ones(3, SIDE, SIDE), 0.25)
    left, top, side = patch_area(box[0], 0.25)
    expected = images.clone()
    expected[..., top : top + side, left : left + side] = 1
    torch.testing.assert_close(pasted, expected)
    assert side**2 == pytest.approx(80 * 40 / 4, rel=0.1)
    assert abs(left + side / 2 - 60) <= 1
    assert abs(top + side / 2 - 50) <= 1


@pytest.mark.parametrize("box", [(-30.0, -20.0, 40.0, 30.0), (60.0, 50.0, 130.0, 110.0), (5.0, 5.0, 6.0, 6.0)])
def test_a_patch_may_reach_over_the_border_and_learns(box: tuple[float, ...]) -> None:
    images, patch = torch.zeros(1, 3, 80, 96), torch.rand(3, SIDE, SIDE).requires_grad_()
    pasted = paste(images, torch.tensor([box]), patch, 0.25)
    assert pasted.shape == images.shape
    pasted.sum().backward()
    assert patch.grad is not None
    assert float(patch.grad.abs().sum()) > 0


@pytest.fixture
def run(scene: Any, tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    (folder / "renders").mkdir(parents=True)
    scene.dataset.folder.rename(folder / "held-out")
    scene.noise.rename(folder / "renders" / "ours")
    return folder


def test_figures_and_sheet(run: Path, detectors: list[Detector], tmp_path: Path) -> None:
    settings = FULL.but(steps=1, views=2)
    results = bench(tmp_path / "out.json", settings, tmp_path / "docs", run, detectors[:1])
    found = {(row["defence"], row["paint"]): row for row in results.rows["outcomes"]}
    assert list(found) == [(d, p) for d in ready_defences() for p in ("normal", "camouflage", "patch", "informed")]
    for (defence, _), row in found.items():
        shares = [row["altered"], row["altered_on_vehicle"], *row["ap"].values(), *row["score"].values()]
        assert all(0 <= share <= 1 for share in shares)
        assert math.isfinite(row["cpu_ms"])
        assert (row["altered"] == 0) >= (defence == "none")
    assert found["lgs", "patch"]["altered_on_vehicle"] > found["lgs", "normal"]["altered_on_vehicle"]
    assert found["none", "normal"]["score"]["yolov4-tiny"] > 0.3
    assert found["none", "informed"]["ap"] == found["none", "patch"]["ap"]
    assert found["jpeg", "informed"]["altered"] != found["jpeg", "patch"]["altered"]  # it went on from the patch
    written = json.loads((tmp_path / "out.json").read_text())
    assert len(written["outcomes"]) == len(found)
    assert Image.open(tmp_path / "docs" / "pictures" / "defences.jpg").size[0] > 1000
    page = (tmp_path / "docs" / "defences.md").read_text()
    assert all(f"| {name} |" in page for name in ready_defences())


def test_a_folder_without_views_is_refused(tmp_path: Path, detectors: list[Detector]) -> None:
    with pytest.raises(RaucaError):
        bench(tmp_path / "out.json", FULL, None, tmp_path, detectors[:1])
    assert not (tmp_path / "out.json").exists()
