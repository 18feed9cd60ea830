"""Evaluating behind a defence: images are defended once, for all detectors and runs."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from rauca_core.contract import RaucaError
from rauca_core.detect import Detector
from rauca_core.runtime.images import read_image
from rauca_core.study import load_results, measure, reference_images
from rauca_core.study.defences import Defence, make_defence


class Counted:
    """A real defence that counts the images it defends."""

    def __init__(self, defence: Defence) -> None:
        self.defence, self.name, self.fingerprint, self.images = defence, defence.name, defence.fingerprint, 0

    def __call__(self, images: torch.Tensor) -> torch.Tensor:
        self.images += len(images)
        return self.defence(images)


def test_detectors_see_defended_images_and_each_is_defended_once(
    scene, detectors: list[Detector], tmp_path: Path
) -> None:
    median = Counted(make_defence("median"))
    renders = {"normal": reference_images(scene.dataset), "noise": scene.noise}
    told: list[str] = []

    def run(defence: Counted | Defence | None, out: str):
        return measure(
            scene.dataset, renders, detectors, tmp_path / out, lambda what, *_: told.append(what), resamples=10,
            defence=defence,
        )  # fmt: skip

    defended = run(median, "median")
    assert median.images == 46
    assert {"median on normal", "median on noise"} <= set(told)
    for paint, rows in defended.images.items():
        for frame, row in zip(defended.frames, rows, strict=True):
            source = scene.dataset.frame_folder(frame.id) / "image.png"
            pixels = read_image(source if paint == "normal" else scene.noise / f"{frame.id}.png")
            image = torch.from_numpy(pixels.transpose(2, 0, 1).copy())[None].float() / 255
            expected = (median.defence(image)[0] * 255).round().permute(1, 2, 0).numpy()
            assert (read_image(tmp_path / "median" / row.path) == expected).all()
    plain = run(make_defence("none"), "none")
    assert (plain.defence, defended.defence) == ("none", "median")
    assert not (tmp_path / "none" / "images").exists()
    assert plain.table == run(None, "none").table != defended.table

    assert run(median, "median") == defended == load_results(tmp_path / "median" / "results.json")
    assert median.images == 46
    changed = scene.noise / "L00-V000-fog.png"
    changed.write_bytes((scene.noise / "L00-V001-fog.png").read_bytes() + b"another file")
    run(median, "median")
    assert median.images == 47
    other = Counted(make_defence("median:size=5"))
    run(other, "median")
    assert other.images == 46


def test_a_part_of_the_frames(scene, detectors: list[Detector], tmp_path: Path) -> None:
    some = ["L00-V001-fog", "L00-V002-clear-day", "L00-V005-clear-day"]
    results = measure(scene.dataset, {"noise": scene.noise}, detectors[:1], tmp_path, resamples=10, only=some)
    assert [row.id for row in results.frames] == ["L00-V002-clear-day", "L00-V001-fog"]
    assert results.dropped == ("L00-V005-clear-day",)
    with pytest.raises(RaucaError, match="none of its 1 frames shows the vehicle"):
        measure(scene.dataset, {"noise": scene.noise}, detectors[:1], tmp_path, only=some[2:])
