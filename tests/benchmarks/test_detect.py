"""The detectors' benchmark on few images, and that its comparison can fail."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from benchmarks import detect_runtimes
from benchmarks.detect import FULL, LARGEST_DIFFERENCE, bench, choose_images, report, squared
from benchmarks.detect_runtimes import ordered_difference, unordered_difference
from benchmarks.harness import Results
from rauca_core.contract import RaucaError
from rauca_core.detect import SOURCES
from rauca_core.detect.weights import ready_names

SMALLEST = FULL.but(
    images=2, timed=1, framework_images=1, torchvision=("ssdlite320_mobilenet_v3_large",), transformers=()
)


@pytest.fixture(autouse=True)
def _threads_are_put_back() -> object:
    before = torch.get_num_threads(), cv2.getNumThreads()
    yield
    torch.set_num_threads(before[0])
    cv2.setNumThreads(before[1])


def test_every_ready_adapter_agrees_with_its_reference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # a fresh clone: no frames, pictures are drawn
    bench(tmp_path / "detect.json", SMALLEST, tmp_path)
    written = json.loads((tmp_path / "detect.json").read_text())
    assert written["image_source"] == "drawn"
    ready = [name for name in ready_names() if SOURCES[name].standard]
    assert [row["name"] for row in written["adapters"]][:-1] == ready
    assert {row["name"] for row in written["missing"]} == {s.name for s in SOURCES.values() if s.standard} - set(ready)
    for row in written["adapters"]:
        assert row["max_abs_difference"] <= LARGEST_DIFFERENCE, row
        assert min(row["forward_ms"], row["backward_ms"], row["reference_forward_ms"]) > 0
        assert row["reference"]
        assert row["images"] == (1 if "random" in row["name"] else 2)
    page = (tmp_path / "detectors.md").read_text()
    assert all(f"| {row['name']} |" in page for row in written["adapters"])


def test_the_comparison_notices_other_weights() -> None:
    name = next((n for n in ready_names() if n == "yolov4-tiny"), None)
    if name is None:
        pytest.skip("yolov4-tiny is not fetched")
    image = squared(choose_images(None, 1)[1][0], 416)
    contender = detect_runtimes.darknet(SOURCES[name])
    assert contender.differences(image) <= LARGEST_DIFFERENCE
    network = contender.detector.network  # type: ignore[attr-defined]
    network.layers[0].weight.data *= 1.1
    assert contender.differences(image) > LARGEST_DIFFERENCE


def test_differences() -> None:
    rows = np.random.default_rng(0).random((5, 6)).astype(np.float32)
    rows[:, 5] = [0, 1, 0, 1, 2]
    off = rows.copy()
    off[3, 1] += 0.25
    assert ordered_difference(rows, off) == pytest.approx(0.25)
    assert ordered_difference(rows, rows[:4]) == float("inf")
    off[3, 1] = np.nan
    assert ordered_difference(rows, off) == 0
    assert ordered_difference(rows, np.full_like(rows, np.nan)) == float("inf")
    assert unordered_difference(rows, rows[::-1]) == 0
    assert unordered_difference(rows, rows[:4]) == float("inf")
    moved, relabeled = rows[::-1].copy(), rows.copy()
    moved[0, 4] += 0.5
    relabeled[4, 5] = 0
    assert unordered_difference(rows, moved) > 0.1
    assert unordered_difference(rows, relabeled) == float("inf")


def test_an_adapter_that_differs_is_named() -> None:
    results = Results("detect", FULL, figures={"image_source": "drawn"})
    row = {"reference": "cv2.dnn", "compared": "predictions", "images": 20, "backward_ms": 20.0}
    for name, difference, ratio in (("good", 1e-6, 0.83), ("bad", float("inf"), 2.0)):
        results.add("adapters", name=name, max_abs_difference=difference, forward_ratio=ratio, **row,
                    forward_ms=10.0, reference_forward_ms=12.0)  # fmt: skip
    results.add("missing", name="absent", why="rauca weights fetch absent")
    report(results)
    assert [(target.what.split()[-1], target.passed) for target in results.targets] == [("bad", False)] * 2
    assert ("absent", "rauca weights fetch absent") in results.tables[-1].rows
    told = json.loads(json.dumps(results.to_json(), allow_nan=False))
    assert told["adapters"][1]["max_abs_difference"] is None


def test_a_data_set_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match=str(tmp_path)):
        choose_images(tmp_path, 3)
