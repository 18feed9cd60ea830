"""Our own detectors' training on drawn frames: what is shown, what is learnt, going on after a stop, mistakes."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest
import torch

from rauca_core.contract import (
    Camera,
    Dataset,
    Frame,
    FramePasses,
    Instance,
    Plan,
    Quality,
    RaucaError,
    Ring,
    Vehicle,
    Weather,
    claim_folder,
    save_frame,
)
from rauca_core.contract.seeding import named_rng
from rauca_core.detect.synth.card import load_weights, read_card
from rauca_core.detect.synth.networks import build_network
from rauca_core.environment.frames import LightFrames
from rauca_core.training import fit as fitting
from rauca_core.training import samples
from rauca_core.training.detector import Job, train
from rauca_core.training.fit import Fit, fit
from rauca_core.training.measure import Findings, Judged, measure
from rauca_core.training.samples import Samples, draw_color, draw_paint
from rauca_core.training.settings import DetectorSettings
from tests.pretend_device import DEVICE, PretendDevice

torch.set_num_threads(1)

NAMES = ("frcnn-synth", "detr-synth")
SIZE = 64
TINY = {"steps": 14, "batch": 2, "lr": 1e-3, "size": SIZE, "round": 14, "threads": 1}


def draw_dataset(folder: Path, vehicle: Vehicle, category: str = "car", light: bool = True) -> Dataset:
    """Four frames at two locations: a bright block on black, and a small dim truck."""
    vehicle = dataclasses.replace(vehicle, category=category)
    ring = Ring((0.0, 180.0), (12.0,), (7.0,))
    weather = Weather("clear", 45.0)
    plan = Plan(
        folder.name, vehicle.name, vehicle.atlas_id, SIZE, Quality(1), light, (weather,), ring, 2, (140, 140, 140),
        0.5, 0, "none",
    )  # fmt: skip
    claim_folder(folder, plan)
    vehicle.save(folder / "vehicle")
    camera = Camera.look_at(np.array([7.0, 0, 2]), np.zeros(3), 45, SIZE, SIZE)
    for frame_id, location, view, _ in plan.frames():
        left, top = 10 + 14 * view, 20 + 8 * location
        box, other = (left, top, left + 24, top + 14), (2, 2, 12, 10)
        paint = np.zeros((SIZE, SIZE), np.float32)
        paint[box[1] : box[3], box[0] : box[2]] = 1
        A, B = np.zeros((SIZE, SIZE, 3), np.float32), np.zeros((SIZE, SIZE, 3), np.float32)
        A[paint > 0], B[paint > 0] = 0.3, 0.6
        B[other[1] : other[3], other[0] : other[2]] = (0.3, 0.1, 0.05)
        passes = FramePasses(A, paint, paint, np.full_like(paint, 7.0))
        passes.A, passes.B, passes.image_linear = (A if light else None), (B if light else None), 0.25 * A + B
        instances = (Instance(1, "truck", tuple(float(v) for v in other), 80),)
        own = tuple(float(v) for v in box)
        frame = Frame(frame_id, location, view, camera, np.eye(4), weather, 0.0, 12.0, 7.0, own, 1.0, 0, instances)
        save_frame(folder / "frames" / frame_id, frame, passes)
    return Dataset(folder)


@pytest.fixture
def folder(tmp_path: Path, box_vehicle: Vehicle) -> Path:
    return draw_dataset(tmp_path / "data", box_vehicle).folder


def score(judged: list[Judged]) -> float:
    """Share of frames whose best box is on the target: enough to see that tests arrive."""
    return float(np.mean([bool(len(one.scores)) for one in judged]))


def job(name: str, folder: Path, out: Path, backbone: Path, device: torch.device | str = "cpu", **chosen) -> Job:
    settings = DetectorSettings.make(**(TINY | chosen))
    frames = LightFrames([folder])
    shown = Samples(frames, ("car", "truck"), SIZE)
    network = build_network(name, 2, backbone)
    return Job(network, shown, range(len(frames)), lambda _: Findings({"all": 0.0}), settings, out, device=device)


def state(network: torch.nn.Module) -> torch.Tensor:
    return torch.cat([t.flatten().double() for t in network.state_dict().values()])


@pytest.mark.parametrize("number", range(6))
def test_boxes_stay_on_their_pixels(folder, number, monkeypatch):
    monkeypatch.setattr(samples, "_camera", lambda image, rng: image.numpy())
    monkeypatch.setattr(samples, "PADDING_SRGB", 0.0)
    shown = Samples(LightFrames([folder]), ("car",), 160)
    sample = shown.draw([number % 4] * (4 if number == 5 else 1), named_rng("boxes", number))
    assert sample.image.shape == (3, 160, 160)
    assert len(sample.truth.boxes) == (4 if number == 5 else 1)
    bright = sample.image.amin(0) > 0.4  # paint is a third of the light: no color can hide the block, the truck is red
    for left, top, right, bottom in sample.truth.boxes.tolist():
        around = torch.zeros_like(bright)
        around[max(0, int(top) - 8) : int(bottom) + 8, max(0, int(left) - 8) : int(right) + 8] = True
        rows, columns = (bright & around).nonzero().unbind(1)
        found = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        assert np.abs(np.array(found, float) - [left, top, right, bottom]).max() < 2


def test_what_stands_around_is_marked_or_not(folder):
    names, frames = ("car", "truck"), LightFrames([folder])
    assert Samples(frames, names, SIZE).truth(0).labels.tolist() == [0, 1]
    assert Samples(frames, names, SIZE, alone=True).truth(0).labels.tolist() == [0]


def test_paint_is_plain():
    for number in range(40):
        rng = named_rng("paint", number)
        color = draw_color(rng)
        assert color.shape == (3,)
        assert ((color >= 0) & (color <= 1)).all()
        paint = draw_paint(rng, (20.0, 60.0), 64)
        assert len(paint[:, :, 0].T.unique(dim=0)) <= 2  # one tone, or two
        assert paint.shape in ((3, 1, 1), (3, 64, 1))


def test_samples_depend_on_their_name_alone(folder):
    shown = Samples(LightFrames([folder]), ("car", "truck"), SIZE)
    first, _, again = (shown.draw([0], named_rng("sight", k)) for k in (1, 2, 1))
    assert torch.equal(first.image, again.image)
    assert torch.equal(first.truth.boxes, again.truth.boxes)


@pytest.mark.parametrize("name", NAMES)
def test_the_loss_falls(name, folder, tmp_path, backbone):
    losses: list[float] = []
    train(job(name, folder, tmp_path / "run", backbone), on_step=lambda done, steps, loss: losses.append(loss))
    assert np.mean(losses[-4:]) < 0.75 * np.mean(losses[:4])
    assert np.isfinite(losses).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_terminated_run_ends_in_the_same_bits(name, folder, tmp_path, backbone):
    short = {"steps": 3, "round": 3}
    whole, _ = train(job(name, folder, tmp_path / "whole", backbone, **short))

    def terminate(done: int, steps: int, loss: float) -> None:
        if done == 2:
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(RaucaError, match="stopped after step 2; run the same command again"):
        train(job(name, folder, tmp_path / "parts", backbone, **short), on_step=terminate)
    rest = job(name, folder, tmp_path / "parts", backbone, **short)
    resumed, _ = train(rest)
    assert torch.equal(state(whole), state(resumed))


@pytest.mark.parametrize("name", NAMES)
def test_on_a_device_a_training_ends_as_on_the_cpu(name, folder, tmp_path, backbone):
    short = {"steps": 2, "round": 2}
    here, _ = train(job(name, folder, tmp_path / "here", backbone, **short))
    with PretendDevice():
        there, _ = train(job(name, folder, tmp_path / "there", backbone, device=DEVICE, **short))
        assert {value.device for value in there.state_dict().values()} == {DEVICE}
        far = state(there).cpu()
    assert (far - state(here)).abs().max() < 1e-3


def test_a_round_that_died_in_its_test_is_reported_once(folder, tmp_path, backbone):
    class Died(BaseException):
        """As SIGKILL: nothing after it runs."""

    def report(run: Job) -> list[tuple[int, float]]:
        told: list[tuple[int, float]] = []
        train(run, on_round=lambda r: told.append((r.step, r.loss)))
        return told

    def die(_: torch.nn.Module) -> Findings:
        raise Died

    lightest = {"steps": 2, "round": 1}
    whole = report(job(NAMES[0], folder, tmp_path / "whole", backbone, **lightest))
    assert [step for step, _ in whole] == [1, 2]
    dying = dataclasses.replace(job(NAMES[0], folder, tmp_path / "parts", backbone, **lightest), test=die)
    with pytest.raises(Died):
        train(dying)
    parts = lambda: job(NAMES[0], folder, tmp_path / "parts", backbone, **lightest)  # noqa: E731
    assert report(parts()) == whole
    assert report(parts()) == []  # finished, and said so before
    lines = (tmp_path / "parts" / "rounds.jsonl").read_text()
    assert lines == (tmp_path / "whole" / "rounds.jsonl").read_text()


def test_fit_leaves_a_detector_and_its_card(folder, tmp_path, backbone, monkeypatch, box_vehicle):
    monkeypatch.setattr(fitting, "fetch", lambda name: backbone)
    ball = draw_dataset(tmp_path / "ball", dataclasses.replace(box_vehicle, name="ball"), category="shape").folder
    settings = DetectorSettings.make(**(TINY | {"steps": 2, "round": 1, "fewest": 2}))
    wanted = Fit(
        name="frcnn-synth",
        datasets=[folder, ball],
        out=tmp_path / "run",
        settings=settings,
        score=score,
        command="rauca detectors train",
    )
    path, findings = fit(wanted)
    card, _ = read_card(path.with_suffix(".json"))
    assert card.class_names == ("car", "truck")
    assert card.metrics == findings.to_json()
    assert findings.frames["box"] == 2  # one location of two is held out
    assert set(findings.false_alarms) == {"ball"}
    assert "not a COCO detector" in card.caution
    assert [entry["tested on"] for entry in card.data] == [2, 2]
    assert len((tmp_path / "run" / "rounds.jsonl").read_text().splitlines()) == 2
    detector = load_weights(path)
    kept = measure(detector, Samples(LightFrames([folder]), card.class_names, SIZE), [0, 1], score)
    assert set(kept.ap50) == {"all", "clear day"}
    _rename(path)
    _start_from(path, folder, tmp_path, settings)
    _damage(path)


def _start_from(path: Path, folder: Path, tmp_path: Path, settings) -> None:
    onward = Fit(
        name="frcnn-synth", datasets=[folder], out=tmp_path / "onward", settings=settings, score=score, start=path
    )
    fit(onward)
    card, _ = read_card(tmp_path / "onward" / "frcnn-synth.json")
    assert card.backbone == read_card(path.with_suffix(".json"))[1]
    with pytest.raises(RaucaError, match=r"holds a frcnn-synth of the classes car, truck, but .* of car, bus"):
        fit(dataclasses.replace(onward, out=tmp_path / "other", classes=("bus",)))


def _rename(path: Path) -> None:
    """Other class names on the card make another fingerprint."""
    card, before = path.with_suffix(".json"), load_weights(path).fingerprint
    whole = card.read_text()
    card.write_text(json.dumps({**json.loads(whole), "class_names": ["truck", "car"]}))
    assert load_weights(path).fingerprint != before
    card.write_text(whole)


def test_a_training_goes_on_with_its_own_classes(folder, tmp_path, backbone, monkeypatch, box_vehicle):
    monkeypatch.setattr(fitting, "fetch", lambda name: backbone)
    boats = draw_dataset(tmp_path / "boats", dataclasses.replace(box_vehicle, name="boat"), category="boat").folder
    settings = DetectorSettings.make(**(TINY | {"steps": 2, "round": 2}))
    trucks = Fit(
        name="frcnn-synth",
        datasets=[folder, boats],
        out=tmp_path / "run",
        settings=settings,
        score=score,
        classes=("truck",),
    )

    def terminate(done: int, steps: int, loss: float) -> None:
        os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(RaucaError, match="stopped after step 1"):
        fit(trucks, on_step=terminate)
    with pytest.raises(RaucaError, match="holds a training with another classes"):
        fit(dataclasses.replace(trucks, classes=("boat",)))
    with pytest.raises(RaucaError, match="--classes boatt: in no frame to train on; choose among boat, car, truck"):
        fit(dataclasses.replace(trucks, classes=("truck", "boatt")))
    spent = tmp_path / "run" / "cpu.json"
    assert json.loads(spent.read_text())["cpu_minutes"] > 0
    spent.write_text('{"cpu_minutes": 100.0}')
    path, _ = fit(trucks)
    card, *_ = read_card(path.with_suffix(".json"))
    assert card.class_names == ("car", "truck")
    assert 100 <= card.cpu_minutes < 200  # what was spent before the stop counts


def _damage(path: Path) -> None:
    card = path.with_suffix(".json")
    whole = json.loads(card.read_text())
    card.write_text(json.dumps({**whole, "class_names": ["car"]}))
    with pytest.raises(RaucaError, match="does not hold the network that its card describes"):
        load_weights(path)
    card.write_text(json.dumps({**whole, "name": "vgg"}))
    with pytest.raises(RaucaError, match="must name one of frcnn-synth, detr-synth"):
        load_weights(path)
    card.write_text(json.dumps(whole))
    path.write_bytes(path.read_bytes()[:-8] + b"\0" * 8)
    with pytest.raises(RaucaError, match="not the file that its card describes"):
        load_weights(path)
    path.unlink()
    with pytest.raises(RaucaError, match="no such weights"):
        load_weights(path)


def test_mistakes_are_named_before_any_training(folder, tmp_path, box_vehicle, backbone, monkeypatch):
    monkeypatch.setattr(fitting, "fetch", lambda name: backbone)
    settings = DetectorSettings.make(**TINY)
    good = Fit(name="frcnn-synth", datasets=[folder], out=tmp_path / "run", settings=settings, score=score)
    dark = draw_dataset(tmp_path / "dark", box_vehicle, light=False).folder
    ball = draw_dataset(tmp_path / "ball", box_vehicle, category="shape").folder
    for changed, message in (
        ({"name": "yolov9"}, "yolov9: not a detector that rauca trains; choose one of frcnn-synth"),
        ({"datasets": [folder, dark]}, "dark: made without light maps"),
        ({"datasets": [tmp_path]}, "not a data set"),
        ({"datasets": [ball]}, "no frame to train on shows a car"),
        ({"tests": [ball]}, "no frame to test on shows a car"),
        ({"tests": [folder]}, "given more than once"),
    ):
        with pytest.raises(RaucaError, match=message):
            fit(dataclasses.replace(good, **changed))
    assert not (tmp_path / "run").exists()
    for option, value in (("steps", 0), ("size", 100), ("precision", "int8"), ("ema", 1.0)):
        with pytest.raises(RaucaError, match=f"{option}: "):
            DetectorSettings.make(**{option: value})


def test_a_loss_that_is_not_finite_names_its_frames(folder, tmp_path, backbone):
    work = job("frcnn-synth", folder, tmp_path / "run", backbone)
    for index in range(4):
        work.samples.frames.get(index).B[:] = float("inf")
    with torch.no_grad():
        work.network.rpn.head.cls_logits.bias[0] = float("nan")
    with pytest.raises(RaucaError, match=r"step 1: the loss or its gradient is not finite on .*L0"):
        train(work)
