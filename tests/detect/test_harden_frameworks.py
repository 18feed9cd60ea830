"""Models of torchvision and transformers that are hardened: what learns, what stays, and what is written back.

MMDetection's are in ``test_mmdet_networks.py``.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from benchmarks.stability.drawn import make_dataset
from rauca_core.attack import random_camouflage
from rauca_core.contract import RaucaError, Vehicle, load_vehicle
from rauca_core.contract.files import write_json
from rauca_core.detect import Detections, load_detector
from rauca_core.detect.frameworks.torchvision_ops import import_torchvision
from rauca_core.detect.frameworks.transformers_loading import import_transformers
from rauca_core.detect.synth.framework_student import FrameworkStudent
from rauca_core.detect.synth.network import Truth
from rauca_core.runtime.images import read_image
from rauca_core.study.harden import link_weights
from rauca_core.training.framework_origin import FrameworkOrigin
from rauca_core.training.harden import Hardening, harden
from rauca_core.training.hardenable import named_as, origin_of
from rauca_core.training.settings import HardenSettings
from tests.detect.test_frameworks_transformers import small_model

pytestmark = pytest.mark.skipif(not importlib.util.find_spec("transformers"), reason="the extra detectors is missing")
torch.set_num_threads(1)

SIZE = 64
SSD = "ssdlite320_mobilenet_v3_large"
CAR = 1  # in the order of both kinds' names
QUERIES = ("detr", "rt_detr", "yolos")
Made = dict[str, str]


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Small models with random weights on disk, as a user names them."""
    folder, made = tmp_path_factory.mktemp("given"), {}
    for kind in QUERIES:
        small_model(kind).save_pretrained(folder / kind)
        scaled = {"size": {"height": SIZE, "width": SIZE}, "image_mean": [0.4] * 3, "image_std": [0.3] * 3}
        write_json(folder / kind / "preprocessor_config.json", scaled)
        made[kind] = str(folder / kind)
    torch.manual_seed(0)
    model = empty_ssd().train()
    for module in model.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = 0.7  # of statistics that three passes fill: else nothing would pass through
    for _ in range(3):
        model(list(torch.rand(4, 3, 320, 320)), [{"boxes": torch.zeros(0, 4), "labels": torch.zeros(0).long()}] * 4)
    state = model.state_dict()
    save_file(state, folder / "ssd.safetensors")
    torch.save({"model": state}, folder / "ssd.pth")
    for name in ("ssd.safetensors", "ssd.pth"):
        (folder / name).with_suffix(".names").write_text("bus\ncar\n")
        made[name] = f"{SSD}={folder / name}"
    return made


def empty_ssd() -> Any:
    return getattr(import_torchvision().models.detection, SSD)(weights=None, weights_backbone=None, num_classes=3)


def car(at: tuple[float, ...] = (10.0, 20.0, 50.0, 45.0)) -> Truth:
    return Truth(torch.tensor([at]), torch.tensor([CAR]))


def nothing() -> Truth:
    return Truth(torch.zeros(0, 4), torch.zeros(0, dtype=torch.int64))


def students_of(typed: str) -> tuple[FrameworkOrigin, FrameworkStudent]:
    origin = origin_of(typed)
    assert isinstance(origin, FrameworkOrigin)
    student, _ = origin.network()
    assert isinstance(student, FrameworkStudent)
    return origin, student.train()


def summed(student: FrameworkStudent, images: Tensor) -> Tensor:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return torch.stack(list(student.losses(images, [car(), nothing()], images).values())).sum()


@pytest.mark.parametrize("kind", [*QUERIES, "ssd.safetensors"])
def test_it_learns_the_car_and_is_written_as_it_was_read(kind: str, given: Made, tmp_path: Path) -> None:
    origin, student = students_of(given[kind])
    images = torch.rand(2, 3, SIZE, SIZE, generator=torch.Generator().manual_seed(1))
    first = float(summed(student, images).detach())
    adam = torch.optim.Adam(student.parameters(), 2e-3)
    for _ in range(25):
        adam.zero_grad()
        summed(student, images).backward()
        adam.step()
    assert float(summed(student, images).detach()) < 0.8 * first
    target = tmp_path / f"hardened-{origin.card.name}{origin.suffix}"
    origin.save(target, student.eval(), origin.card)
    written, before = load_detector(named_as(given[kind], target)), load_detector(given[kind])
    assert (written.name, written.class_names) == (target.stem, before.class_names)
    assert written.fingerprint != before.fingerprint
    found, meant = written.dense(images), student.dense(images)
    assert torch.equal(found.classes, meant.classes)
    assert torch.equal(found.boxes, meant.boxes)
    assert not torch.allclose(found.classes, before.dense(images).classes, atol=1e-3)
    of_framework = opened_by_framework(kind, target)
    if kind in QUERIES:
        prepared = written.scaling.fit("", images)
        logits = of_framework(pixel_values=prepared).logits
        own = logits.softmax(-1)[..., :-1] if kind != "rt_detr" else logits.sigmoid()
        torch.testing.assert_close(own, found.classes, atol=1e-5, rtol=1e-4)
    assert isinstance(origin_of(named_as(given[kind], target)), FrameworkOrigin)  # it can be hardened again


def opened_by_framework(kind: str, path: Path) -> Any:
    """The model as its own framework loads it, without rauca."""
    if kind in QUERIES:
        auto = import_transformers().AutoModelForObjectDetection
        return auto.from_pretrained(path).eval()
    model = empty_ssd()
    model.load_state_dict(load_file(path))
    return model.eval()


def test_statistics_and_scales_of_batch_normalization_stay(given: Made, tmp_path: Path) -> None:
    origin, student = students_of(given["ssd.safetensors"])
    adam = torch.optim.SGD(student.parameters(), 1e-3)
    summed(student, torch.rand(2, 3, SIZE, SIZE)).backward()
    adam.step()
    origin.save(tmp_path / "after.safetensors", student, origin.card)
    before, after = load_file(origin.weights), load_file(tmp_path / "after.safetensors")
    network = student.detector.network
    norms = [name for name, module in network.named_modules() if isinstance(module, nn.BatchNorm2d)]
    assert len(norms) > 30
    for name in before:
        same = name.rpartition(".")[0] in norms
        assert torch.equal(before[name], after[name]) or not same, name
    assert not torch.equal(before["backbone.features.0.0.0.weight"], after["backbone.features.0.0.0.weight"])


class Said:
    """A detector as it was, which found these boxes of class 0."""

    def __init__(self, *boxes: tuple[float, ...]) -> None:
        self.boxes, self.shown = torch.tensor(boxes), list[Tensor]()

    def to(self, device: torch.device) -> Said:
        return self

    def detect(self, images: Tensor, score_threshold: float) -> list[Detections]:
        self.shown.append(images)
        count = len(self.boxes)
        return [Detections(self.boxes, torch.full((count,), 0.9), torch.zeros(count, dtype=torch.int64))] * len(images)


class Listening:
    """A detector that notes the truth it is told."""

    def __init__(self) -> None:
        self.network, self.told = nn.Conv2d(3, 1, 1), list[Truth]()

    def losses(self, images: Tensor, truths: Sequence[Truth]) -> dict[str, Tensor]:
        self.told = list(truths)
        return {"loss": self.network(images).mean()}


def test_what_it_said_elsewhere_is_truth_and_what_it_said_of_the_vehicle_is_not() -> None:
    on_it, elsewhere, empty = (12.0, 20.0, 52.0, 45.0), (1.0, 1.0, 9.0, 9.0), (60.0, 60.0, 60.2, 63.0)
    heard: Any = Listening()
    said: Any = Said(on_it, elsewhere, empty)
    images, plain = torch.rand(2, 2, 3, SIZE, SIZE)
    FrameworkStudent(heard, said).losses(images, [car(), nothing()], plain)
    assert [one is plain for one in said.shown] == [True]
    first, second = heard.told
    assert first.boxes.tolist() == [list(car().boxes[0]), list(elsewhere)]
    assert first.labels.tolist() == [CAR, 0]
    assert second.boxes.tolist() == [list(on_it), list(elsewhere)]


@pytest.mark.parametrize("kind", ["rt_detr", "ssd.pth"])
def test_a_killed_hardening_of_a_model_ends_in_the_same_bytes(
    kind: str, given: Made, tmp_path: Path, box_vehicle: Vehicle
) -> None:
    data = make_dataset(tmp_path / "data", box_vehicle, SIZE, (40.0, 130.0, 250.0))
    noise = tmp_path / "noise.json"
    random_camouflage(noise, load_vehicle(data.vehicle_folder, read_image), SIZE, seed=3, cell=8)
    settings = HardenSettings.make(
        rounds=2, steps=2, every=1, batch=2, attack_steps=0, map_size=SIZE, samples=4, threads=1, inner_step=0.3
    )

    def job(out: str) -> Hardening:
        return Hardening(
            given[kind], [data.folder], [noise], tmp_path / out, settings, lambda *_: [noise], lambda judged: 0.5
        )

    def stop(number: int, done: int, steps: int, loss: float) -> None:
        if (number, done) == (2, 1):
            raise KeyboardInterrupt

    whole = harden(job("whole"))
    with pytest.raises((KeyboardInterrupt, RaucaError)):
        harden(job("parts"), on_step=stop)
    resumed = harden(job("parts"))
    assert files(whole) == files(resumed)
    assert len(load_detector(named_as(given[kind], whole)).detect(torch.rand(1, 3, SIZE, SIZE))) == 1
    linked = link_weights(whole.parent, tmp_path / "linked")
    assert files(linked) == files(whole)
    assert load_detector(named_as(given[kind], linked)).name == whole.stem


def files(path: Path) -> dict[str, bytes]:
    """What a file, or a folder, holds."""
    held = sorted(path.iterdir()) if path.is_dir() else [path]
    return {one.name: one.read_bytes() for one in held}


def test_what_cannot_be_trained_is_told_with_the_way_out(
    given: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    way_out = r"rauca dataset export .*--before"
    with pytest.raises(RaucaError, match=rf"ssd-mobilenet-v2: rauca hardens .*{way_out}"):
        origin_of("ssd-mobilenet-v2")
    model = small_model("detr")
    model.config.id2label = {0: "boat", 1: "bus", 2: "train"}
    model.save_pretrained(tmp_path / "boats")
    with pytest.raises(RaucaError, match=r"boats: .*car"):
        origin_of(str(tmp_path / "boats"))
    monkeypatch.setattr(
        "rauca_core.detect.frameworks.transformers_detector.TransformersDetector.losses", lambda *_: {}["loss"]
    )
    with pytest.raises(RaucaError, match=rf"yolos: cannot be trained; its own losses fail .*{way_out}") as told:
        origin_of(given["yolos"])
    assert "\n" not in str(told.value)
