"""The detectors that rauca ships: what they are, what they see, and their gradients to the image."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from benchmarks.vehicle import car_score
from rauca_core.contract import Camera, load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.detect import load_detector
from rauca_core.detect.catalogue import SOURCES
from rauca_core.detect.synth.card import read_card
from rauca_core.detect.weights import shipped_path
from rauca_core.environment.shading import plain_shading
from rauca_core.runtime.images import read_image

pytestmark = pytest.mark.stored

torch.set_num_threads(1)

NAMES = ("frcnn-synth", "detr-synth")
SIDE = 160


@cache
def loaded(name: str) -> Any:
    return load_detector(name)


@cache
def drawn(vehicle: str, azimuth: float = 40.0) -> tuple[Tensor, Tensor]:
    """A vehicle by our own rasterizer on a plain road under a plain sky: image (1, 3, S, S) and its box (1, 4)."""
    angle = np.radians(azimuth)
    eye = np.array([6.5 * np.cos(angle), 6.5 * np.sin(angle), 2.0])
    shading = plain_shading(
        load_vehicle(assets_folder() / "vehicles" / vehicle, read_image),
        Camera.look_at(eye, np.array([0, 0, 0.7]), 60, SIDE, SIDE),
    )
    ground = torch.where(torch.arange(SIDE)[None, :, None] < SIDE // 3, 0.75, 0.35).expand(3, SIDE, SIDE)
    picture = shading.x_nr(torch.tensor([0.25, 0.35, 0.6])[:, None, None]) + (1 - shading.coverage) * ground
    rows, columns = (shading.coverage[0] > 0.5).nonzero().unbind(1)
    box = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
    return picture[None].clamp(0, 1), torch.tensor([[float(v) for v in box]])


@pytest.mark.parametrize("name", NAMES)
def test_cards_say_what_they_are(name):
    path = shipped_path(SOURCES[name])
    card, _ = read_card(path.with_suffix(".json"))
    assert path.stat().st_size <= 20e6
    assert card.name == name
    assert "not a COCO detector" in card.caution
    assert card.class_names[0] == "car"
    assert card.command.startswith(f"rauca detectors train {name}")
    assert sum(entry["frames"] for entry in card.data) > 500
    assert card.metrics["ap50"]["clear day"] >= 0.85
    assert card.metrics["ap50"]["all"] >= 0.75


@pytest.mark.parametrize("name", NAMES)
def test_a_car_is_a_car_and_a_ball_is_none(name):
    scores = {vehicle: float(car_score(loaded(name), *drawn(vehicle))) for vehicle in ("sedan", "sphere")}
    assert scores["sedan"] > 0.5
    assert scores["sphere"] < 0.5


@pytest.mark.parametrize("name", NAMES)
def test_the_box_fits_at_any_size(name):
    image, box = drawn("sedan")
    wide = torch.nn.functional.pad(image, (30, 10, 0, 0), value=0.5)  # letterboxed inside
    found = loaded(name).detect(wide)[0]
    best = found.boxes[found.labels == 0][0] - torch.tensor([30.0, 0, 30, 0])
    assert (best - box[0]).abs().max() < 0.1 * (box[0, 2] - box[0, 0])
    assert found.scores.diff().le(0).all()


def check_gradient(total: Callable[[Tensor], Tensor]) -> None:
    """Along one random direction, against central differences."""
    generator = torch.Generator().manual_seed(1)
    grain = torch.rand(1, 3, SIDE, SIDE, generator=generator, dtype=torch.float64)
    images = (0.9 * drawn("sedan")[0] + 0.05 * grain).requires_grad_()  # flat areas would tie in the pooling
    (gradient,) = torch.autograd.grad(total(images), images)
    assert torch.isfinite(gradient).all()
    assert (gradient.abs().sum(1) > 0).float().mean() > 0.9
    direction = torch.randn(images.shape, generator=generator, dtype=torch.float64)
    step = 1e-8  # smaller than the distance to most kinks of millions of activations
    with torch.no_grad():
        numeric = (total(images + step * direction) - total(images - step * direction)) / (2 * step)
    torch.testing.assert_close((gradient * direction).sum(), numeric, rtol=1e-3, atol=1e-9)


def test_gradient_of_two_stage_for_given_proposals(monkeypatch):
    network = load_detector("frcnn-synth").network.double()
    box = drawn("sedan")[1][0].double()
    proposals = [torch.stack([box, box + torch.tensor([-12.0, 4, 3, 9]), torch.tensor([5.0, 5, 60, 50])])]
    monkeypatch.setattr(network.rpn, "forward", lambda *arguments: (proposals, {}))

    def total(images: Tensor) -> Tensor:
        found = network.dense(images)
        return found.classes.square().sum() + 0.01 * found.boxes.sum()

    check_gradient(total)


def test_gradient_of_transformer_for_given_starts():
    network = load_detector("detr-synth").network.double()
    fixed: dict[str, Tensor] = {}

    def hold(module: Any, arguments: Any, named: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
        """Where queries start takes no gradient, so it must not move; the first layer's answer depends on it alone."""
        for name in ("inputs_embeds", "reference_points"):
            named[name] = fixed.setdefault(name, named[name].detach())
        return arguments, named

    network.detr.decoder.register_forward_pre_hook(hold, with_kwargs=True)

    def total(images: Tensor) -> Tensor:
        found = network.detr(images)
        return found.intermediate_logits[:, 0].sigmoid().sum() + found.intermediate_reference_points[:, 0].sum()

    check_gradient(total)


@pytest.mark.parametrize("name", NAMES)
def test_a_small_step_against_the_gradient_hides_the_car_a_little(name):
    image, box = drawn("sedan")
    image = image.clone().requires_grad_()
    score = car_score(loaded(name), image, box).sum()
    (gradient,) = torch.autograd.grad(score, image)
    on_car = gradient.abs()[0].sum(0)[int(box[0, 1]) : int(box[0, 3]), int(box[0, 0]) : int(box[0, 2])]
    assert on_car.mean() > 2 * gradient.abs()[0].sum(0).mean()
    with torch.no_grad():
        after = car_score(loaded(name), (image - 0.01 * gradient.sign()).clamp(0, 1), box).sum()
    assert after < score
