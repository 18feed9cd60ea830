"""The whole chain against a published detector: what it takes for a car stops being one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from benchmarks.vehicle import car_score
from rauca_core.attack import make_settings, run_optimization
from rauca_core.attack.frames import FrameStore, boxes_of, render_batch
from rauca_core.contract import Dataset, load_camouflage, load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.detect import Detector, load_detector
from rauca_core.render import MipmappedTexture, srgb_to_linear
from rauca_core.runtime.images import read_image
from tests.published import published_weights


@pytest.fixture(scope="module")
def yolo() -> Detector:
    published_weights("yolov3-tiny")
    return load_detector("yolov3-tiny", 256)


def test_a_few_steps_hide_the_sedan(yolo: Detector, tmp_path: Path, dataset_factory: Callable[..., Dataset]) -> None:
    sedan = load_vehicle(assets_folder() / "vehicles" / "sedan", read_image)
    dataset = dataset_factory(tmp_path / "data", sedan, 256, (60.0, 300.0))
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
