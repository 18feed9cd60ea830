"""The library's own entry: a data set, detectors and a method in, a camouflage out that hides a car."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from benchmarks.stability.drawn import make_dataset
from benchmarks.vehicle import car_score
from rauca_core.attack import make_settings, optimize, random_camouflage, run_optimization, settings_of
from rauca_core.attack.frames import FrameStore, boxes_of, render_batch
from rauca_core.contract import Dataset, RaucaError, Vehicle, load_camouflage, load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.detect import Detector, load_detector
from rauca_core.render import MipmappedTexture, srgb_to_linear
from rauca_core.render.mipmap import texel_coverage
from rauca_core.runtime.devices import find_device
from rauca_core.runtime.images import read_image
from tests.published import published_weights

SMALL: dict[str, Any] = {"batch": 2, "map_size": 64, "samples": 2}


def test_without_a_folder_the_camouflage_is_in_memory(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    seen: list[Any] = []
    found = optimize(dataset.folder, [small_detector], steps=3, on_step=seen.append, **SMALL)
    assert (found.path, found.texture.shape, found.texture.dtype) == (None, (64, 64, 3), np.uint8)
    assert [row["loss"] for row in found.history] == [report.loss for report in seen]
    saved, image = load_camouflage(found.save(tmp_path / "paint.json"))
    assert saved == found.record
    assert (read_image(image) == found.texture).all()


def test_it_is_the_run_of_the_methods_settings(dataset: Dataset, small_detector: Any, tmp_path: Path) -> None:
    chosen = make_settings(**settings_of("fca", steps=4, lr=0.02, **SMALL))
    path = run_optimization(dataset, [small_detector], chosen, tmp_path / "run")
    optimize(dataset, [small_detector], "fca", steps=2, lr=0.02, out=tmp_path / "mine", **SMALL)
    found = optimize(dataset, [small_detector], "fca", steps=4, lr=0.02, out=tmp_path / "mine", **SMALL)
    assert found.path == tmp_path / "mine" / "camouflage.json"
    assert found.path.read_bytes() == path.read_bytes()
    assert found.path.with_suffix(".png").read_bytes() == path.with_suffix(".png").read_bytes()


def test_without_a_device_a_gpu_is_taken_and_the_log_says_so(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert find_device(None) == torch.device("cpu")
    assert not caplog.text
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    with contextlib.suppress(RaucaError):  # where there is none after all
        assert find_device(None).type == "cuda"
    assert "no device named: working on a GPU" in caplog.text


def test_what_is_unknown_is_refused(dataset: Dataset, small_detector: Any) -> None:
    with pytest.raises(RaucaError, match="method: no 'best'"):
        optimize(dataset, [small_detector], "best", **SMALL)
    with pytest.raises(RaucaError, match="speed"):
        optimize(dataset, [small_detector], speed=3)
    with pytest.raises(RaucaError, match="device cuda:99"):
        optimize(dataset, [small_detector], device="cuda:99", **SMALL)
    with pytest.raises(RaucaError, match="no-such-detector"):
        optimize(dataset, ["no-such-detector"], **SMALL)


@pytest.fixture(scope="module")
def yolo() -> Detector:
    published_weights("yolov3-tiny")
    return load_detector("yolov3-tiny", 256)


def test_a_few_steps_hide_the_sedan(yolo: Detector, tmp_path: Path) -> None:
    sedan = load_vehicle(assets_folder() / "vehicles" / "sedan", read_image)
    dataset = make_dataset(tmp_path / "data", sedan, 256, (60.0, 300.0))
    chosen = make_settings(steps=14, batch=4, map_size=256, samples=2, start="plain", roa=False, checkpoint_every=20)
    path = run_optimization(dataset, [yolo], chosen, tmp_path / "out")

    # Judge the PNG as anyone would load it, not the texels the optimizer held.
    store = FrameStore(dataset, chosen)
    batch = [store.ready(i) for i in range(len(store))]

    def score(uv_map: torch.Tensor) -> float:
        texture = MipmappedTexture(store.pyramid, srgb_to_linear(store.pyramid.from_map(uv_map)))
        return float(car_score(yolo, render_batch(batch, texture), boxes_of(batch)).mean())

    image = torch.tensor(read_image(load_camouflage(path)[1])).permute(2, 0, 1) / 255
    before, after = score(torch.full((3, 256, 256), 0.5)), score(image)
    assert before > 0.4
    assert after < 0.5 * before


def test_random_paint_is_uniform_per_cell(box_vehicle: Vehicle, tmp_path: Path) -> None:
    random_camouflage(tmp_path / "a.json", box_vehicle, size=256, seed=1, cell=4)
    camouflage, image = load_camouflage(tmp_path / "a.json")
    pixels = read_image(image)
    inside = (texel_coverage(box_vehicle, 256) > 0).reshape(64, 4, 64, 4).all((1, 3))
    cells = pixels.reshape(64, 4, 64, 4, 3).transpose(0, 2, 1, 3, 4)[inside]
    assert (cells == cells[:, :1, :1]).all()
    assert np.allclose(cells[:, 0, 0].mean(0), 127.5, atol=8)
    assert cells.min() < 3
    assert cells.max() > 252
    camouflage.check_fits(box_vehicle.atlas_id, "test")
    assert camouflage.made["cell_texels"] == 4
    random_camouflage(tmp_path / "b.json", box_vehicle, size=256, seed=1, cell=4)
    random_camouflage(tmp_path / "c.json", box_vehicle, size=256, seed=2, cell=4)
    assert (tmp_path / "b.png").read_bytes() == (tmp_path / "a.png").read_bytes()
    assert (tmp_path / "c.png").read_bytes() != (tmp_path / "a.png").read_bytes()
    with pytest.raises(RaucaError, match="cell"):
        random_camouflage(tmp_path / "d.json", box_vehicle, size=256, cell=0)
