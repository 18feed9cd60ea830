"""A darknet network that learns: its losses, what it keeps, and the detector that comes of it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from rauca_core.detect import load_detector
from rauca_core.detect.darknet import read_weights
from rauca_core.detect.darknet_network import Convolution, DarknetNetwork
from rauca_core.detect.interface import DensePredictions
from rauca_core.detect.synth.card import save_weights
from rauca_core.detect.synth.darknet_student import DarknetStudent
from rauca_core.detect.synth.network import Truth
from rauca_core.detect.synth.student_losses import KEEP_WEIGHT, cross_entropy, image_losses
from rauca_core.training.hardenable import origin_of

torch.set_num_threads(1)

SIZE = 64


@pytest.fixture
def student(cfg: Path, weights: Path) -> DarknetStudent:
    """Of the small network with every layer type; two classes, of which 1 is the car."""
    made, before = DarknetStudent(cfg), DarknetNetwork(cfg)
    for network in (made.network, before):
        read_weights(weights, network)
    made.remember(before)
    return made


def car() -> Truth:
    return Truth(torch.tensor([[12.0, 20.0, 44.0, 40.0]]), torch.tensor([1]))


def nothing() -> Truth:
    return Truth(torch.zeros(0, 4), torch.zeros(0, dtype=torch.int64))


def test_without_vehicles_there_is_nothing_to_learn(student: DarknetStudent) -> None:
    images = torch.rand(2, 3, SIZE, SIZE)
    losses = student.losses(images, [nothing(), nothing()], images)
    assert all(abs(float(loss.detach())) < 1e-5 for loss in losses.values())
    torch.stack(list(losses.values())).sum().backward()
    assert all(p.grad is None or p.grad.abs().max() < KEEP_WEIGHT * 1e-6 for p in student.parameters())


def test_it_learns_the_car_and_keeps_the_rest(student: DarknetStudent) -> None:
    """Of a network that says little of anything, as trained ones do of most of a picture."""
    with torch.no_grad():
        for network in (student.network, *student._before):
            for head in network.layers:
                if isinstance(head, Convolution) and len(head.bias) % 7 == 0:  # anchors of 7 numbers
                    head.bias[4::7] -= 5  # their objectness
    torch.manual_seed(0)
    images = torch.rand(2, 3, SIZE, SIZE)
    before = student.dense(images)
    adam = torch.optim.Adam(student.parameters(), lr=5e-3)
    history = []
    for _ in range(60):
        losses = student.losses(images, [car(), nothing()], images)
        total = torch.stack(list(losses.values())).sum()
        adam.zero_grad()
        total.backward()
        adam.step()
        history.append({name: float(loss.detach()) for name, loss in losses.items()})
    first, last = history[0], history[-1]
    for name, share in (("present", 0.9), ("class", 0.9), ("box", 0.5)):
        assert last[name] < share * first[name], name
    after = student.dense(images)
    assert (after.objectness[1] - before.objectness[1]).abs().mean() < 0.15  # the image without a car
    assert all(torch.isfinite(p).all() for p in student.parameters())


def test_cross_entropy_is_zero_where_both_agree_and_finite_at_the_ends() -> None:
    p = torch.tensor([0.0, 1e-9, 0.3, 1.0], requires_grad=True)
    assert cross_entropy(p, p.detach()).abs().max() < 1e-5
    ends = cross_entropy(p, torch.tensor([1.0, 1.0, 0.3, 0.0]))
    ends.sum().backward()
    assert torch.isfinite(ends).all()
    assert torch.isfinite(p.grad).all()


@pytest.mark.parametrize("logit", [-60.0, -20.0, -14.0, 14.0, 16.0])
def test_cross_entropy_keeps_its_slope_where_a_camouflage_won(logit: float) -> None:
    x = torch.tensor([logit], requires_grad=True)
    cross_entropy(x.sigmoid(), torch.tensor([1.0 if logit < 0 else 0.0])).sum().backward()
    assert float(x.grad) == pytest.approx(-1.0 if logit < 0 else 1.0, abs=1e-3)


def test_a_lost_vehicle_is_taught_and_not_kept_lost() -> None:
    """Predictions beside the vehicle answer for it, too far off to be on it; all others keep to what was, of which the
    last is a part of it."""
    boxes = torch.tensor([[[28.0, 20.0, 60.0, 40.0]] * 3 + [[80.0, 80.0, 90.0, 90.0], [14.0, 24.0, 20.0, 30.0]]])
    logits = torch.full((1, 5), -20.0, requires_grad=True)
    classes = torch.full((1, 5, 2), 0.5)
    found = DensePredictions(boxes, logits.sigmoid(), classes)
    losses = image_losses(found, DensePredictions(boxes, torch.full((1, 5), 0.02), classes), 0, car())
    (present,) = torch.autograd.grad(losses["present"], logits, retain_graph=True)
    (kept,) = torch.autograd.grad(losses["kept"], logits)
    assert present[0].tolist() == pytest.approx([-1 / 3] * 3 + [0.0, 0.0])
    assert kept[0].tolist() == pytest.approx([0.0] * 3 + [-0.02 * KEEP_WEIGHT] * 2)


def test_boxes_beside_the_vehicle_are_kept_by_what_was_said_in_them() -> None:
    """The first moved, of a sure object; the second as far, of an unsure one; the third stayed. Objectness is 1
    everywhere, as YOLOv8's is."""
    boxes = torch.tensor([[[70.0, 60.0, 90.0, 80.0], [10.0, 60.0, 30.0, 80.0], [40.0, 60.0, 60.0, 80.0]]])
    sure = torch.ones(1, 3)
    classes = torch.tensor([[[0.0, 0.8], [0.0, 0.02], [0.0, 0.8]]])
    moved = (boxes + torch.tensor([[[4.0, 0, 4, 0]] * 2 + [[0.0] * 4]])).requires_grad_()
    kept = image_losses(DensePredictions(moved, sure, classes), DensePredictions(boxes, sure, classes), 0, nothing())[
        "kept"
    ]
    apart = 1 - 16 / 24  # of equal boxes side by side the hull is their union
    assert float(kept.detach()) == pytest.approx(KEEP_WEIGHT * 0.82 * apart**2, rel=1e-4)
    kept.backward()
    first, second, third = moved.grad[0].abs().amax(1).tolist()
    assert first == pytest.approx(40 * second, rel=1e-3)
    assert third == 0


def test_what_is_kept_was_said_of_the_plain_picture(student: DarknetStudent) -> None:
    camouflaged, plain = torch.rand(2, 1, 3, SIZE, SIZE)
    with torch.no_grad():
        kept = [float(student.losses(camouflaged, [nothing()], one)["kept"]) for one in (camouflaged, plain)]
        wanted = cross_entropy(student.dense(camouflaged).objectness, student.dense(plain).objectness).sum()
    assert kept[0] == pytest.approx(0, abs=1e-5)
    assert kept[1] > float(wanted) > 1e-3  # classes count beside it


def test_published_weights_come_back_as_the_same_detector(tiny_weights: dict[str, Path], tmp_path: Path) -> None:
    assert tiny_weights["yolov3-tiny"].is_file()
    origin = origin_of("yolov3-tiny")
    network, card = origin.network()
    path = tmp_path / "mine.safetensors"
    save_weights(path, network, card)
    first, again = origin.detector(), load_detector(str(path))
    assert (again.name, again.class_names) == ("yolov3-tiny", first.class_names)
    image = torch.rand(1, 3, 96, 96)
    one, other = first.dense(image), again.dense(image)
    assert one.boxes.shape == other.boxes.shape
    assert (one.objectness * one.classes.amax(-1) - other.objectness * other.classes.amax(-1)).abs().max() < 0.01
    onward, _ = origin.network(path)  # a later round: its own weights, and the first ones to keep to
    assert isinstance(onward, DarknetStudent)
    losses = onward.losses(image, [car()], image)
    assert all(torch.isfinite(loss) for loss in losses.values())
    assert origin_of(str(path)).card.name == "yolov3-tiny"
