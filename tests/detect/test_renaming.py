"""Class names of a detector's own, read as those of data sets; merged classes are one."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from rauca_core.attack.das import attention_layer
from rauca_core.attack.ensemble import DetectorEnsemble
from rauca_core.contract import RaucaError
from rauca_core.detect import DarknetDetector, DensePredictions, class_index, load_detector, parse_classes, renamed
from rauca_core.detect.nms import SinglePassDetector, detections

OWN = ("vehicle.car", "vehicle.taxi", "n/a", "Pole", "n/a", "truck")
MAPPING = {"vehicle.car": "car", "Vehicle.Taxi": "car"}


class Painted(SinglePassDetector):
    """Pixel (row, column) holds the probability of class ``column`` in box ``row``."""

    name, class_names, fingerprint, network = "painted", OWN, "painted", None
    boxes = torch.tensor([[0.0, 0, 10, 10], [0, 0, 10, 9], [20, 20, 30, 30]])

    def _predict(self, images: Tensor) -> DensePredictions:
        return DensePredictions(
            self.boxes.expand(len(images), -1, -1), images.new_ones(len(images), 3), images[:, 0, :3, : len(OWN)]
        )


def picture() -> Tensor:
    images = torch.zeros(1, 3, 40, 40)
    rows = [[0.9, 0.3, 0.1, 0.2, 0.0, 0.0], [0.2, 0.8, 0.0, 0.0, 0.1, 0.0], [0.1, 0.7, 0.0, 0.6, 0.0, 0.5]]
    images[0, 0, :3, : len(OWN)] = torch.tensor(rows)
    return images


def test_dense_gives_a_merged_class_its_largest_probability() -> None:
    detector, images = renamed(Painted(), MAPPING), picture().requires_grad_()
    assert detector.class_names == ("n/a", "Pole", "n/a", "truck", "car")
    found = detector.dense(images)
    car = class_index(detector, "car")
    assert torch.allclose(found.classes[0, :, car], torch.tensor([0.9, 0.8, 0.7]))
    assert torch.equal(found.classes[0, :, 1], images[0, 0, :3, 3])
    found.classes[..., car].sum().backward()
    assert images.grad is not None
    assert images.grad[0, 0, :3, :2].tolist() == [[1, 0], [0, 1], [0, 1]]
    attacked = DetectorEnsemble([detector], "car").attack(picture(), torch.tensor([[0.0, 0, 10, 10]]))
    assert attacked.gradient.abs().sum() > 0


def test_detect_suppresses_a_merged_class_once_more() -> None:
    """The car and the taxi in the same place are one car; a pole where a taxi stands stays."""
    own, merged = Painted(), renamed(Painted(), MAPPING)
    (before,), (after,) = (one.detect(picture(), 0.4, 0.5) for one in (own, merged))
    assert [OWN[label] for label in before.labels] == ["vehicle.car", "vehicle.taxi", "vehicle.taxi", "Pole", "truck"]
    assert [merged.class_names[label] for label in after.labels] == ["car", "car", "Pole", "truck"]
    assert torch.allclose(after.scores, torch.tensor([0.9, 0.7, 0.6, 0.5]))
    assert after.boxes.tolist() == [[0, 0, 10, 10]] + [[20, 20, 30, 30]] * 3
    (whole,) = detections(merged.dense(picture()), 0.4, 0.5)
    assert torch.equal(whole.boxes, after.boxes)
    assert torch.equal(whole.labels, after.labels)


def test_a_class_that_has_the_name_already_is_merged() -> None:
    detector = renamed(Painted(), {"vehicle.car": "truck"})
    assert detector.class_names == ("vehicle.taxi", "n/a", "Pole", "n/a", "truck")
    assert detector.dense(picture()).classes[0, :, 4].tolist() == pytest.approx([0.9, 0.2, 0.5])


def test_names_alone_change_no_prediction(cfg: Any, weights: Any) -> None:
    cfg.with_suffix(".names").write_text("schiff\nauto\n")
    plain = load_detector(str(weights), 64)
    other = load_detector(str(weights), 64, classes={"auto": "Car"})
    images = torch.rand(1, 3, 50, 60, generator=torch.Generator().manual_seed(0))
    assert other.class_names == ("schiff", "car")
    assert torch.equal(plain.dense(images).classes, other.dense(images).classes)
    (one,), (two,) = (detector.detect(images) for detector in (plain, other))
    assert len(one.scores) > 2
    assert torch.equal(one.scores, two.scores)
    assert torch.equal(one.labels, two.labels)
    assert attention_layer(other) is attention_layer(other.to("cpu"))


def test_the_fingerprint_follows_the_mapping(detector: DarknetDetector) -> None:
    mappings: list[dict[str, str]] = [{}, {"boat": "ship"}, {"boat": "car"}, {"car": "boat"}, {"boat": "van"}]
    assert len({renamed(detector, one).fingerprint for one in mappings}) == len(mappings)
    assert renamed(detector, {}) is detector
    assert renamed(detector, {"boat": "car"}).fingerprint == renamed(detector, {"Boat": "car"}).fingerprint


def test_a_class_that_is_not_there_lists_those_that_are(detector: DarknetDetector) -> None:
    with pytest.raises(RaucaError, match=r"every: has no class 'vehicle.car' to rename; its own are boat, car$"):
        renamed(detector, {"vehicle.car": "car"})


def test_what_is_typed() -> None:
    assert parse_classes("vehicle.car=car, vehicle.fire truck = truck,a=b=bus") == {
        "vehicle.car": "car",
        "vehicle.fire truck": "truck",
        "a=b": "bus",
    }
    for text, message in {
        "": "--classes: '' is no OWN=NAME; write it like",
        "car": "--classes: 'car' is no OWN=NAME",
        "a=car,": "--classes: '' is no OWN=NAME",
        "=car": "--classes: '=car' is no OWN=NAME",
        "a=car,a=bus": "--classes: 'a' stands twice",
    }.items():
        with pytest.raises(RaucaError, match=message):
            parse_classes(text)
