"""ONNX files that are hardened: what learns, what is written back, and what is refused beforehand."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper

from benchmarks.stability.drawn import make_dataset
from rauca_core.attack import random_camouflage
from rauca_core.contract import RaucaError, Vehicle, load_vehicle
from rauca_core.detect import load_detector
from rauca_core.detect.onnx_graph import read_graph, to_torch
from rauca_core.detect.onnx_weights import learnt_tensors, with_tensors
from rauca_core.detect.synth.card import read_any_card
from rauca_core.detect.synth.network import Truth
from rauca_core.runtime.images import read_image
from rauca_core.training.harden import Hardening, harden
from rauca_core.training.hardenable import named_as, origin_of
from rauca_core.training.interpolation import mixed
from rauca_core.training.onnx_origin import OnnxOrigin
from rauca_core.training.settings import HardenSettings

torch.set_num_threads(1)

Exported = Callable[..., Path]
SIZE = 64
SHAPE = (1, 3, SIZE, SIZE)


def numbers(path: Path) -> dict[str, np.ndarray]:
    return {one.name: numpy_helper.to_array(one) for one in onnx.load(path).graph.initializer}


def ends(path: Path) -> list[str]:
    graph = onnx.load(path).graph
    return [str(one) for one in (*graph.input, *graph.output)] + [node.op_type for node in graph.node]


def car() -> Truth:
    return Truth(torch.tensor([[10.0, 20.0, 50.0, 45.0]]), torch.tensor([1]))


def shared_graph(path: Path) -> Path:
    """Two convolutions with one kernel, one with numbers of its own, and one whose weights are a formula."""
    rng = np.random.default_rng(0)
    stored = {
        "twice": rng.normal(size=(3, 3, 1, 1)),
        "formula": np.arange(3.0).reshape(1, 3, 1, 1),
        "own": rng.normal(size=(3, 3, 3, 3)),
        "read": rng.normal(size=3),
    }
    nodes = [
        helper.make_node("Identity", ["twice"], ["again"]),
        helper.make_node("Conv", ["images", "twice"], ["a"]),
        helper.make_node("Conv", ["a", "again"], ["b"]),
        helper.make_node("Conv", ["b", "own", "read"], ["c"], pads=[1, 1, 1, 1]),
        helper.make_node("Conv", ["c", "formula"], ["d"]),
    ]
    outputs = [helper.make_tensor_value_info("d", TensorProto.FLOAT, [1, 1, SIZE, SIZE])]
    constants = [numpy_helper.from_array(value.astype(np.float32), name) for name, value in stored.items()]
    image = helper.make_tensor_value_info("images", TensorProto.FLOAT, SHAPE)
    graph = helper.make_graph(nodes, "graph", [image], outputs, constants)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8), path)
    return path


def test_what_layers_share_is_one_tensor_and_a_formula_never_learns(tmp_path: Path) -> None:
    graph = read_graph(shared_graph(tmp_path / "shared.onnx"))
    learnt = learnt_tensors(graph, to_torch(graph, SHAPE))
    assert {name: len(one.places) for name, one in learnt.items()} == {"twice": 2, "own": 1, "read": 1}


def test_what_something_else_reads_does_not_learn(tmp_path: Path) -> None:
    path = shared_graph(tmp_path / "shared.onnx")
    model = onnx.load(path)
    model.graph.node[3].output[0] = "before"
    model.graph.node.insert(4, helper.make_node("Sigmoid", ["before"], ["between"]))  # else the two become one
    model.graph.node.insert(5, helper.make_node("Mul", ["between", "scale"], ["c"]))
    model.graph.node.insert(0, helper.make_node("Reshape", ["read", "shape"], ["scale"]))
    model.graph.initializer.append(numpy_helper.from_array(np.array([1, 3, 1, 1]), "shape"))
    onnx.save(model, path)
    graph = read_graph(path)
    assert set(learnt_tensors(graph, to_torch(graph, SHAPE))) == {"twice", "own"}


@pytest.mark.parametrize("kind", ["v5", "v8", "yolox"])
def test_it_learns_the_car_and_the_file_says_what_the_network_does(
    kind: str, exported: Exported, tmp_path: Path
) -> None:
    path, target = exported(kind), tmp_path / f"hardened-{kind}.onnx"
    typed = f"yolox={path}" if kind == "yolox" else str(path)  # named as Ultralytics' files are, it does not say so
    origin = origin_of(typed)
    assert isinstance(origin, OnnxOrigin)
    student, card = origin.network()
    images = 0.4 * torch.rand(2, 3, SIZE, SIZE, generator=torch.Generator().manual_seed(1))
    images[0, :, 20:45, 10:50] += 0.6  # the car is bright
    truths = [car(), Truth(torch.zeros(0, 4), torch.zeros(0, dtype=torch.int64))]
    first = {name: float(loss.detach()) for name, loss in student.losses(images, truths, images).items()}
    assert abs(first["kept"]) < 1e-3  # nothing was learnt yet
    adam = torch.optim.Adam(student.parameters(), 1e-3)
    for _ in range(160):
        adam.zero_grad()
        torch.stack(list(student.losses(images, truths, images).values())).sum().backward()
        adam.step()
    last = {name: float(loss.detach()) for name, loss in student.losses(images, truths, images).items()}
    assert last["class"] < 0.8 * first["class"]
    origin.save(target, student, card)
    written, before = load_detector(named_as(typed, target)), load_detector(typed)
    assert (written.name, written.class_names) == (f"hardened-{kind}", before.class_names)
    assert written.fingerprint != before.fingerprint
    found, meant = written.dense(images), student.dense(images)
    assert torch.allclose(found.classes, meant.classes, atol=1e-4)
    assert torch.allclose(found.boxes, meant.boxes, rtol=1e-3, atol=1e-2)
    assert not torch.allclose(found.classes, before.dense(images).classes, atol=1e-2)
    assert ends(target) == ends(path)
    again, _ = origin.network(target)  # a later round: its weights, and the first ones to keep to
    assert torch.equal(again.dense(images).classes, meant.classes)
    assert float(again.losses(images, truths, images)["kept"].detach()) == pytest.approx(last["kept"], rel=1e-4)


def test_written_back_unchanged_it_is_the_same_graph(exported: Exported, tmp_path: Path) -> None:
    path, target = exported("v8"), tmp_path / "same.onnx"
    graph = read_graph(path)
    target.write_bytes(with_tensors(graph, {}, "a note"))
    before, after = numbers(path), numbers(target)
    assert all(np.array_equal(before[name], after[name]) for name in before)
    assert read_graph(target).metadata == graph.metadata | {"rauca": "a note"}


def test_a_hardening_of_a_file_ends_in_a_file(exported: Exported, tmp_path: Path, box_vehicle: Vehicle) -> None:
    data = make_dataset(tmp_path / "data", box_vehicle, SIZE, (40.0, 130.0, 250.0))
    noise, path = tmp_path / "noise.json", exported("v8")
    random_camouflage(noise, load_vehicle(data.vehicle_folder, read_image), 64, seed=3, cell=8)
    settings = HardenSettings.make(
        rounds=2, steps=2, every=1, batch=2, attack_steps=0, map_size=64, samples=4, threads=1
    )

    def job(out: str) -> Hardening:
        return Hardening(
            str(path), [data.folder], [noise], tmp_path / out, settings, lambda *_: noise, lambda judged: 0.5
        )

    whole = harden(job("whole"))
    assert whole.name == f"hardened-{path.stem}.onnx"
    hardened = load_detector(str(whole))
    assert len(hardened.detect(torch.rand(1, 3, SIZE, SIZE))) == 1
    changed = [name for name, value in numbers(whole).items() if not np.array_equal(value, numbers(path)[name])]
    assert changed
    card, _ = read_any_card(whole.with_suffix(".json"))
    assert (card.steps, card.settings["rounds"], card.metrics["ap50"]["all"]) == (4, 2, 0.5)

    origin, half = origin_of(str(path)), tmp_path / "half.onnx"  # kept of what was learnt
    network = origin.network(whole)[0]
    network.load_state_dict(mixed(origin.network()[0].state_dict(), network.state_dict(), 0.5))
    origin.save(half, network, card)
    first, last, between = numbers(path), numbers(whole), numbers(half)
    assert all(np.allclose(between[name], (first[name] + last[name]) / 2, rtol=1e-5, atol=1e-7) for name in changed)

    def stop(number: int, done: int, steps: int, loss: float) -> None:
        if (number, done) == (2, 1):
            raise KeyboardInterrupt

    with pytest.raises((KeyboardInterrupt, RaucaError)):
        harden(job("parts"), on_step=stop)
    resumed = harden(job("parts"))
    assert hashlib.sha256(resumed.read_bytes()).digest() == hashlib.sha256(whole.read_bytes()).digest()


@pytest.mark.parametrize(("kind", "why"), [("end2end", "cannot be trained"), ("detr", "says each object once")])
def test_what_cannot_be_trained_is_told_with_the_way_out(kind: str, why: str, exported: Exported) -> None:
    with pytest.raises(RaucaError, match=rf"{why}.*rauca dataset export .*--before"):
        origin_of(str(exported(kind)))
