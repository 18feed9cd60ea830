"""A look at a detector before it is assessed: real ones pass, and the usual mistakes are named."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor
from typer.testing import CliRunner

from pipelines.cli import app
from rauca_core.contract import RaucaError
from rauca_core.contract.schema import Fields
from rauca_core.detect import DensePredictions, Detections, Detector, load_detector
from rauca_core.detect.renaming import renamed
from rauca_core.study.cost import Work, cost_of
from rauca_core.study.plain_cars import plain_cars
from rauca_core.study.preflight import Preflight, preflight
from rauca_core.study.wiring import NONE_OF_THEM
from tests.detect.conftest import EVERY_LAYER, write_random_weights
from tests.published import published_weights

torch.set_num_threads(1)


@pytest.fixture(autouse=True)
def all_pictures_are_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """However slow the machine is that the tests run on."""
    monkeypatch.setattr("rauca_core.study.preflight.LOOK_S", 1e6)


@pytest.fixture(scope="module")
def yolo() -> Detector:
    published_weights("yolov4-tiny")
    return load_detector("yolov4-tiny")


@pytest.fixture(scope="module")
def shipped() -> Detector:
    return load_detector("frcnn-synth")


@dataclass
class Miswired:
    """A detector with something changed on the way in or out."""

    inner: Detector
    class_names: tuple[str, ...] = ()
    see: Callable[[Tensor], Tensor] = lambda images: images
    box: Callable[[Tensor], Tensor] = lambda boxes: boxes
    score: Callable[[Tensor], Tensor] = lambda scores: scores
    name: str = "mine"
    fingerprint: str = "0"
    looks: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.class_names = self.class_names or self.inner.class_names

    def to(self, device: torch.device | str) -> Detector:
        return self

    def dense(self, images: Tensor) -> DensePredictions:
        found = self.inner.dense(self.see(images))
        return DensePredictions(self.box(found.boxes), self.score(found.objectness), self.score(found.classes))

    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        self.looks.append(len(images))
        found = self.inner.detect(self.see(images), score_threshold, iou_threshold)
        return [replace(one, boxes=self.box(one.boxes)) for one in found]


def test_the_pictures_are_small_and_hold_a_car_each() -> None:
    images, boxes = plain_cars()
    assert images.shape == (12, 3, 320, 320)
    assert (images.amin() >= 0, images.amax() <= 1) == (True, True)
    width, height = (boxes[:, 2:] - boxes[:, :2]).T
    assert ((width > 60) & (height > 30) & (boxes >= 0).all(1) & (boxes <= 320).all(1)).all()


def test_a_detector_that_is_wired_up_right_passes(yolo: Detector) -> None:
    found = preflight(yolo, works={"quick": Work(24, 8, 48, 300)})
    assert found.warnings == ()
    assert found.ap > 0.8
    assert found.found >= found.pictures - 2
    assert (found.name, found.family, found.class_index, found.input_size) == ("yolov4-tiny", "darknet", 2, 416)
    assert found.differentiable
    assert found.ms_step is not None
    assert found.ms_step > 0.5 * found.ms_forward > 0
    assert found.costs["quick"].attack_s > found.costs["quick"].look_s > 0
    whole: Any = json.loads(json.dumps(found.to_json()))
    assert Preflight.from_json(Fields(whole, "preflight")).to_json() == found.to_json()


def test_names_that_are_one_off_are_told(yolo: Detector) -> None:
    with_background = ("background", *yolo.class_names[:-1])
    (few, why) = preflight(Miswired(yolo, with_background)).warnings
    assert few.startswith("it sees few of the plain cars: AP@0.5 is 0.0")
    assert "as class 2, 'bicycle', where 3 is 'car'; one lower: are the names one off, with a background" in why
    (_, why) = preflight(Miswired(yolo, (*yolo.class_names[1:], "last"))).warnings
    assert "where 1 is 'car'; one higher: are the names one off, without a background" in why


def test_a_class_of_another_name_is_asked_for(shipped: Detector) -> None:
    mine = Miswired(shipped, ("vehicle", "boat", "bus", "truck"))
    with pytest.raises(
        RaucaError, match=r"mine: calls \d+ of \d+ plain cars 'vehicle', .*; give --classes 'vehicle=car'"
    ):
        preflight(mine)
    found = preflight(renamed(mine, {"vehicle": "car"}))
    assert (found.warnings, found.class_names[0], found.family) == ((), "car", "miswired")
    with pytest.raises(
        RaucaError, match=r"none of its 4 classes \(car, boat, bus, truck \.\.\.\) is 'dog'; give --classes"
    ):
        preflight(Miswired(shipped, box=lambda boxes: boxes * 0), "dog")


def test_a_function_is_looked_at_too(shipped: Detector) -> None:
    def mine(images: Tensor) -> list[dict[str, Tensor]]:
        return [vars(one) for one in shipped.detect(images)]

    found = preflight(load_detector(mine, names=shipped.class_names))
    assert (found.name, found.family, found.ap > 0.9, found.differentiable) == ("mine", "callable", True, False)
    assert found.warnings == (f"it cannot be attacked itself: {found.why_not}",)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (lambda boxes: boxes / 320, "shares of the image"),
        (lambda boxes: torch.cat([boxes[:, :2], boxes[:, 2:] - boxes[:, :2]], 1), "corner, width and height"),
    ],
)
def test_boxes_in_another_form_are_told(shipped: Detector, wrong: Callable[[Tensor], Tensor], told: str) -> None:
    found = preflight(Miswired(shipped, box=lambda boxes: wrong(boxes) if boxes.ndim == 2 else boxes))
    assert any(f"if its boxes are {told}: give x0, y0, x1, y1 in pixels" in warning for warning in found.warnings)


def test_red_and_blue_swapped_are_told() -> None:
    """Though no car is lost by it."""
    published_weights("yolov3-tiny")
    (slight,) = preflight(Miswired(load_detector("yolov3-tiny"), see=lambda images: images.flip(1))).warnings
    assert slight.startswith("it is surer of the cars, by 0.")
    assert "with red and blue swapped: is it given RGB where it was trained on BGR" in slight


def test_values_of_another_range_are_told(shipped: Detector) -> None:
    few, why = preflight(Miswired(shipped, see=lambda images: (images * 255).clamp(max=1))).warnings
    assert few.startswith("it sees few of the plain cars")
    assert "with values divided by 255: is it given 0..255 where it was trained on 0..1?" in why


def test_what_nothing_explains_is_said(shipped: Detector) -> None:
    found = preflight(Miswired(shipped, see=lambda images: images * 0))
    assert (found.ap, found.found) == (0, 0)
    assert found.warnings[-1] == NONE_OF_THEM


@pytest.mark.parametrize(
    ("score", "why"),
    [
        (lambda scores: scores.detach(), "no gradient flows from its scores to the image; compute them from the image"),
        (
            lambda scores: (scores * 100).round() / 100,
            "the gradient of its best score is 0 everywhere; where it rounds",
        ),
        (lambda scores: scores + (scores - scores).sqrt(), "the gradient of its best score is not finite"),
    ],
)
def test_gradients_that_do_not_reach_the_image_are_told(
    shipped: Detector, score: Callable[[Tensor], Tensor], why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rauca_core.study.preflight.LOOK_S", 0.0)
    found = preflight(Miswired(shipped, score=score), works={"quick": Work(24, 8, 48, 300)})
    assert not found.differentiable
    assert why in found.why_not
    assert found.warnings == (f"it cannot be attacked itself: {found.why_not}",)
    assert found.ms_step is None
    assert found.costs["quick"].attack_s == 0


def test_the_reason_of_the_detector_itself_is_handed_on(shipped: Detector) -> None:
    def refuse(images: Tensor) -> Tensor:
        if images.requires_grad:
            raise RaucaError("mine: has no gradients; mine.onnx: convert it")
        return images

    assert preflight(Miswired(shipped, see=refuse)).why_not == "mine: has no gradients; mine.onnx: convert it"


def test_a_slow_detector_is_shown_fewer_pictures(shipped: Detector, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rauca_core.study.preflight.LOOK_S", 0.0)
    slow = Miswired(shipped)
    assert preflight(slow).pictures == 4
    assert sum(slow.looks) < 12


def test_costs_grow_with_the_work() -> None:
    work = Work(views=32, paints=8, lit_views=48, steps=300, batch=4)
    cost = cost_of(work, 100.0, 250.0, cores=2)
    assert cost.look_s == pytest.approx(25.6)
    assert cost.attack_s == pytest.approx(300 * 4 * 0.25 * 1.15)
    assert cost_of(work, 100.0, 250.0, cores=8).render_s == pytest.approx(cost.render_s / 4, rel=0.01)
    without = cost_of(work, 100.0, None, cores=2)
    assert (without.attack_s, without.look_s) == (0, cost.look_s)
    assert 0 < without.render_s < cost.render_s
    assert 0 < without.disk_bytes < cost.disk_bytes


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A seeded network of darknet's layers, which takes nothing for a car."""
    (tmp_path / "small.cfg").write_text(EVERY_LAYER)
    return write_random_weights(tmp_path / "small.weights", tmp_path / "small.cfg")


def test_the_command_says_what_was_found(small: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.names").write_text("boat\nvehicle\n")
    command = ["detectors", "check", str(small), "--names", str(tmp_path / "mine.names"), "--size", "64"]
    with pytest.raises(RaucaError, match=r"small: none of its 2 classes \(boat, vehicle \.\.\.\) is 'car'"):
        CliRunner().invoke(app, command, catch_exceptions=False)
    command += ["--classes", "vehicle=car", "--json", str(tmp_path / "found.json")]
    said = CliRunner().invoke(app, command, catch_exceptions=False)
    assert said.exit_code == 1
    assert "2; cars are class 1, 'car'" in said.stdout
    assert "64 pixels, its longer side" in said.stdout
    assert "warning: it sees few of the plain cars" in said.stderr
    assert json.loads((tmp_path / "found.json").read_text())["class_names"] == ["boat", "car"]


def test_the_command_ends_with_0_where_all_is_well() -> None:
    said = CliRunner().invoke(app, ["detectors", "check", "frcnn-synth"], catch_exceptions=False)
    assert said.exit_code == 0, said.stderr
    assert "gradients" in said.stdout
    assert "warning" not in said.stderr


def test_the_command_refuses_what_cannot_be_read(small: Path, tmp_path: Path) -> None:
    def run(*words: str) -> None:
        CliRunner().invoke(app, ["detectors", "check", *words], catch_exceptions=False)

    with pytest.raises(RaucaError, match=r"nothing\.weights: not found"):
        run(str(tmp_path / "nothing.weights"))
    with pytest.raises(RaucaError, match=r"--classes: 'car' is no OWN=NAME"):
        run("frcnn-synth", "--classes", "car")
    (tmp_path / "small.names").write_text("boat\ncar\n")
    small.write_bytes(small.read_bytes()[:1000])
    with pytest.raises(RaucaError, match=r"small\.weights: expected \d+ bytes for this network, found 1000"):
        run(str(small), "--names", str(tmp_path / "small.names"), "--size", "64")
