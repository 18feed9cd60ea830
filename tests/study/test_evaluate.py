"""An evaluation from images to results.json, with published weights on drawn cars."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
import torch

from rauca_core.contract import RaucaError
from rauca_core.contract.files import png_bytes, write_bytes
from rauca_core.detect import Detections, Detector
from rauca_core.runtime.images import read_image
from rauca_core.study.average_precision import Sample, average_precision
from rauca_core.study.detection_cache import DetectionSettings
from rauca_core.study.detectors import check_detectors
from rauca_core.study.results import AXES, Results
from rauca_core.study.study import Entry
from tests.study.measured import measure


class Counting:
    """Passes everything on to a real detector and counts the images that reach it."""

    def __init__(self, detector: Detector) -> None:
        self.name, self.class_names, self.fingerprint = detector.name, detector.class_names, detector.fingerprint
        self.dense = detector.dense
        self.detector = detector
        self.images = 0

    def detect(
        self, images: torch.Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45
    ) -> list[Detections]:
        self.images += len(images)
        return self.detector.detect(images, score_threshold, iou_threshold)


def run(scene, detectors: list[Detector], out: Path, settings: DetectionSettings | None = None) -> Results:
    renders = {"normal": scene.dataset.folder, "noise": scene.noise}
    return measure(scene.dataset, renders, detectors, out, settings=settings)


def test_results_are_what_detecting_by_hand_gives(scene, detectors: list[Detector], tmp_path: Path) -> None:
    results = run(scene, detectors, tmp_path / "out")
    assert results.paints == ("normal", "noise")
    assert len(results.frames) == 23
    assert results.dropped == ("L00-V005-clear-day",)
    folders = {
        "normal": lambda i: scene.dataset.frame_folder(i) / "image.png",
        "noise": lambda i: scene.noise / f"{i}.png",
    }
    frames = [frame for frame in scene.dataset.frames() if frame.box_xyxy is not None]
    for (paint, path_of), detector in itertools.product(folders.items(), detectors):
        samples = []
        for frame in frames:
            pixels = read_image(path_of(frame.id))
            (found,) = detector.detect(torch.from_numpy(pixels.transpose(2, 0, 1).copy())[None].float() / 255)
            cars = found.labels == detector.class_names.index("car")
            boxes, scores = found.boxes[cars].double().numpy(), found.scores[cars].double().numpy()
            samples.append(Sample(np.array(frame.box_xyxy), boxes, scores))
        estimate = results.table[paint][detector.name]
        assert estimate.ap == pytest.approx(average_precision(samples), abs=0.02)  # the cache keeps 0.01 pixels
        assert estimate.low <= estimate.ap <= estimate.high
        assert 0.2 < estimate.ap < 1.0
    assert results.table["normal"] != results.table["noise"]
    assert all(set(row) == {detector.name for detector in detectors} for row in results.table.values())


def test_groups_follow_the_nominal_camera_and_the_weather(scene, detectors: list[Detector], tmp_path: Path) -> None:
    results = run(scene, detectors[:1], tmp_path / "out")
    sizes = {axis: {group.value: group.frames for group in results.groups[axis]} for axis in AXES}
    assert sizes == {
        "azimuth_deg": {0.0: 6, 90.0: 5, 180.0: 6, 270.0: 6},
        "elevation_deg": {10.0: 23},
        "distance_m": {6.0: 12, 9.0: 11},
        "sun_altitude_deg": {10.0: 8, 45.0: 15},
        "fog_density": {0.0: 15, 90.0: 8},
    }
    (whole,) = results.groups["elevation_deg"]
    name = detectors[0].name
    assert whole.ap["noise"][name] == pytest.approx(results.table["noise"][name].ap, abs=1e-12)
    entry = Entry("seen", "none", "box", "car", results, tmp_path / "out")
    mean, every = entry.recorded.mean_of_group([name], "noise", "elevation_deg", whole), results.table["noise"][name]
    assert (mean.ap, mean.low, mean.high) == pytest.approx((every.ap, every.low, every.high))
    assert (results.place_kind, results.place_count) == ("views", 8)  # one location
    clear, foggy = (group.ap["normal"][name] for group in results.groups["fog_density"])
    assert foggy < clear


def test_a_second_run_detects_only_what_is_new(scene, detectors: list[Detector], tmp_path: Path) -> None:
    out = tmp_path / "out"
    counting = Counting(detectors[0])
    first = run(scene, [counting], out)
    assert counting.images == 46
    assert run(scene, [counting], out) == first
    assert counting.images == 46
    changed = scene.noise / "L00-V000-fog.png"
    changed.write_bytes((scene.noise / "L00-V001-fog.png").read_bytes() + b"another file")
    run(scene, [counting], out)
    assert counting.images == 47
    run(scene, [counting], out, settings=DetectionSettings(iou_threshold=0.6))
    assert counting.images == 47 + 46


def test_a_damaged_cache_is_mended_by_detecting_again(scene, detectors: list[Detector], tmp_path: Path) -> None:
    counting = Counting(detectors[0])
    first = run(scene, [counting], tmp_path / "out")
    (cache,) = (tmp_path / "out" / "detections").iterdir()
    lines = cache.read_bytes().splitlines()
    hole = b"\0" * 200  # a block that the disk never wrote
    good = json.loads(lines[-1]) | {
        "boxes": [[0, 1, 2, 3], [4, 5, 6, 7]],
        "scores": [0.5, 0.2],
        "names": ["car", "bus"],
    }
    wrong = (
        {"boxes": [[0, 1, 2, 3]]}, {"boxes": [[0, 1, 2], [4, 5, 6]]}, {"scores": [0.5, None]}, {"names": ["car"]},
        {"image": 3},
    )  # fmt: skip
    lost = [json.dumps(good | change).encode() for change in wrong]
    cache.write_bytes(b"\n".join([lines[0][:30], hole, *lost, *lines[2:-1], lines[-1][:-40]]))
    assert run(scene, [counting], tmp_path / "out") == first
    assert counting.images == 46 + 3
    assert sorted(cache.read_bytes().splitlines()) == sorted(lines)


def test_wrongly_sized_renders_are_named(scene, detectors: list[Detector], tmp_path: Path) -> None:
    write_bytes(scene.noise / "L00-V003-fog.png", png_bytes(np.zeros((50, 60, 3), np.uint8)))
    with pytest.raises(RaucaError, match=r"60x50 pixels, frame L00-V003-fog has 192x192"):
        run(scene, detectors[:1], tmp_path / "out")
    assert not (tmp_path / "out" / "results.json").exists()


def test_bad_requests_are_refused(detectors: list[Detector]) -> None:
    for given, category, complaint in (
        ([], "car", "no detectors given"),
        ([detectors[0], detectors[0]], "car", "must have names of their own"),
        (detectors, "tank", "knows no class 'tank'"),
    ):
        with pytest.raises(RaucaError, match=complaint):
            check_detectors(given, category)
