"""Hardening on drawn frames: what is composed, both steps of a round, going on after a stop, mistakes."""

from __future__ import annotations

import hashlib
import os
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.stability.drawn import make_dataset
from rauca_core.attack import make_settings, random_camouflage, run_optimization
from rauca_core.attack.frames import FrameStore, render_batch
from rauca_core.contract import Camouflage, Dataset, RaucaError, Vehicle, load_vehicle, save_camouflage
from rauca_core.contract.files import png_bytes, write_json
from rauca_core.contract.seeding import named_rng
from rauca_core.detect import Detections, Detector, load_detector
from rauca_core.detect.synth.card import load_network, read_card
from rauca_core.detect.synth.network import Truth
from rauca_core.detect.synth.own_student import OwnStudent
from rauca_core.detect.synth.student_losses import KEPT, with_kept
from rauca_core.environment.frames import LightFrames
from rauca_core.render import MipmappedTexture, TapSettings
from rauca_core.runtime.distributed import Processes
from rauca_core.runtime.images import read_image
from rauca_core.training.camouflaged import CamouflagedSamples, read_texels, vary
from rauca_core.training.harden import Hardening, harden
from rauca_core.training.measure import Judged
from rauca_core.training.settings import HardenSettings
from tests.pretend_device import DEVICE, PretendDevice

torch.set_num_threads(1)

SIZE, MAP, SAMPLES = 64, 64, 4
CPU = torch.device("cpu")
LABELS = torch.zeros(0, dtype=torch.int64)
RECIPE = TapSettings(MAP, SAMPLES)
TINY = {
    "rounds": 2, "steps": 2, "every": 2, "batch": 2, "attack_steps": 2, "attack_batch": 1, "map_size": MAP,
    "samples": SAMPLES, "threads": 1, "inner_step": 0.3,
}  # fmt: skip


@pytest.fixture
def data(tmp_path: Path, box_vehicle: Vehicle) -> Dataset:
    return make_dataset(tmp_path / "data", box_vehicle, SIZE, (40.0, 130.0, 250.0))


@pytest.fixture
def noise(tmp_path: Path, data: Dataset) -> Path:
    path = tmp_path / "noise.json"
    random_camouflage(path, load_vehicle(data.vehicle_folder, read_image), MAP, seed=3, cell=8)
    return path


def score(judged: list[Judged]) -> float:
    """Share of frames in which anything was found: enough to see that tests arrive."""
    return float(np.mean([bool(len(one.scores)) for one in judged]))


def attack(data: Dataset, device: torch.device):
    """The real one, a few steps of it."""
    processes = Processes(0, 1, device)

    def run(detector: Detector, number: int, folder: Path) -> list[Path]:
        settings = make_settings(
            steps=2, batch=1, map_size=MAP, samples=SAMPLES, seed=number, name=f"round-{number}", checkpoint_every=1
        )
        done = folder / "camouflage.json"
        if done.is_file():
            return [done]
        return [run_optimization(data, [detector], settings, folder, processes=processes)]

    return run


def hardening(data: Dataset, out: Path, camouflages: list[Path], device: torch.device = CPU, **chosen) -> Hardening:
    settings = HardenSettings.make(**(TINY | chosen))
    return Hardening(
        "frcnn-synth", [data.folder], camouflages, out, settings, attack(data, device), score, "rauca harden",
        device=device,
    )  # fmt: skip


def dressed(data: Dataset, noise: Path, tmp_path: Path, share: float, varied: bool = False) -> CamouflagedSamples:
    frames = LightFrames([data.folder])
    return CamouflagedSamples(frames, ("car",), SIZE, [noise], tmp_path / "taps", share, RECIPE, varied)


def test_composed_frames_are_those_of_the_optimizer(data: Dataset, noise: Path, tmp_path: Path) -> None:
    worn = dressed(data, noise, tmp_path, share=1.0)
    store = FrameStore(data, make_settings(map_size=MAP, samples=SAMPLES, tap_folder=tmp_path / "taps"))
    texels = read_texels(noise.with_suffix(".png"), store.pyramid)
    batch = [store.ready(index) for index in range(len(store))]
    theirs = render_batch(batch, MipmappedTexture(store.pyramid, texels))
    for index, image in enumerate(theirs):
        ours = worn.plain(index, named_rng("frame", index)).image
        assert (ours - image).abs().max() < 0.003  # 8 bits of the picture around, half precision of the light
        plain = store.light.of(store.frames[index])[1].transpose(2, 0, 1) / np.float32(255)
        assert (ours - torch.from_numpy(plain)).abs().max() > 0.2


def test_a_share_wears_camouflage_and_the_rest_is_as_before(data: Dataset, noise: Path, tmp_path: Path) -> None:
    half, none = (dressed(data, noise, tmp_path, share) for share in (0.5, 0.0))
    changed = 0
    for number in range(24):
        mixed, plain = (s.draw([number % 6], named_rng("sight", number)).image for s in (half, none))
        assert mixed.shape == plain.shape == (3, SIZE, SIZE)
        painted = half.painted(number % 6, named_rng("sight", number))
        off_paint = half.frames.get(number % 6).A.amax(0) == 0
        as_it_is = half.frames.get(number % 6).B.float()
        assert torch.equal(painted[:, off_paint], as_it_is[:, off_paint])
        changed += len(painted[:, ~off_paint].flatten(1).unique(dim=1).T) > 40  # noise has many colors
    assert 4 <= changed <= 20


def test_varied_colors_stay_albedos(data: Dataset, noise: Path) -> None:
    texels = torch.rand(50, 3)
    drawn = [vary(texels, named_rng("vary", k)) for k in range(40)]
    assert all(((one >= 0) & (one <= 1)).all() and one.shape == (50, 3) for one in drawn)
    assert 10 <= sum(torch.equal(one, texels) for one in drawn) <= 32


def test_a_killed_hardening_ends_in_the_same_bits(data: Dataset, noise: Path, tmp_path: Path) -> None:
    tests: list[str] = []
    plain = harden(hardening(data, tmp_path / "plain", [noise], inner_step=0.0))
    whole = harden(hardening(data, tmp_path / "whole", [noise]), on_test=lambda found: tests.append(found.summary))
    assert len(tests) == 2
    assert all("in camouflage" in one for one in tests)

    def terminate(number: int, done: int, steps: int, loss: float) -> None:
        if (number, done) == (2, 1):
            os.kill(os.getpid(), signal.SIGTERM)

    parts = hardening(data, tmp_path / "parts", [noise])
    with pytest.raises(RaucaError, match="stopped after step 1; run the same command again to go on"):
        harden(parts, on_step=terminate)
    resumed = harden(parts)
    assert digest(resumed) == digest(whole)
    assert digest(whole) != digest(plain)  # an attack inside every step
    _the_result(resumed, noise)
    with pytest.raises(RaucaError, match=r"holds a hardening with another steps;"):
        harden(hardening(data, tmp_path / "parts", [noise], steps=3))
    assert digest(harden(parts)) == digest(whole)


def test_on_a_device_a_hardening_ends_as_on_the_cpu(data: Dataset, noise: Path, tmp_path: Path) -> None:
    short = {"rounds": 1, "steps": 1, "every": 1}
    here, _, _ = load_network(harden(hardening(data, tmp_path / "here", [noise], **short)))
    with PretendDevice():
        weights = harden(hardening(data, tmp_path / "there", [noise], device=DEVICE, **short))
    there, _, _ = load_network(weights)
    for one, other in zip(here.state_dict().values(), there.state_dict().values(), strict=True):
        assert (one - other).abs().max() < 1e-3


class Finds:
    """A detector that finds the same in every image: the car, something beside it, a sliver, what it is not sure of."""

    name, class_names, fingerprint = "finds", ("car", "bus"), ""
    boxes = torch.tensor(
        [[12.0, 11.0, 41.0, 30.0], [50.0, 8.0, 60.0, 20.0], [3.0, 40.0, 3.5, 60.0], [2.0, 2.0, 8.0, 8.0]]
    )
    scores, labels = torch.tensor([0.9, 0.8, 0.7, 0.2]), torch.tensor([1, 1, 0, 0])

    def __init__(self) -> None:
        self.shown: list[torch.Tensor] = []

    def to(self, device: torch.device) -> Finds:
        return self

    def detect(self, images: torch.Tensor, threshold: float) -> list[Detections]:
        self.shown.append(images)
        sure = self.scores >= threshold
        return [Detections(self.boxes[sure], self.scores[sure], self.labels[sure]) for _ in images]


def test_what_was_found_beside_the_vehicle_is_truth_too() -> None:
    car, nothing = Truth(torch.tensor([[10.0, 10.0, 40.0, 30.0]]), torch.tensor([0])), Truth(torch.zeros(0, 4), LABELS)
    told, empty = with_kept(Finds().detect(torch.zeros(2, 3, SIZE, SIZE), KEPT), [car, nothing])
    assert told.boxes.tolist() == [[10.0, 10.0, 40.0, 30.0], [50.0, 8.0, 60.0, 20.0]]
    assert told.labels.tolist() == [0, 1]
    assert empty.labels.tolist() == [1, 1]  # no vehicle to lie on

    network, heard = load_detector("frcnn-synth").network, list[Truth]()

    class Listens(torch.nn.Module):
        backbone, dense = network.backbone, network.dense

        def losses(self, images: torch.Tensor, truths: list[Truth]) -> dict[str, torch.Tensor]:
            heard.extend(truths)
            return {"one": images.sum()}

    images, plain = torch.zeros(2, 1, 3, SIZE, SIZE)
    before = Finds()
    OwnStudent(Listens(), before).losses(images, [car], plain)
    assert [one is plain for one in before.shown] == [True]
    assert [truth.labels.tolist() for truth in heard] == [[0, 1]]


def digest(weights: Path) -> str:
    return hashlib.sha256(weights.read_bytes()).hexdigest()


def _the_result(weights: Path, noise: Path) -> None:
    hardened, first = load_detector(str(weights)), load_detector("frcnn-synth")
    assert (hardened.name, hardened.class_names) == ("hardened-frcnn-synth", first.class_names)
    assert hardened.fingerprint not in ("", first.fingerprint)
    card, _ = read_card(weights.with_suffix(".json"))
    assert card.name == "frcnn-synth"
    assert "hardened" not in card.caution
    made = card.hardened["camouflages"]
    assert [(one["name"], one["against"]) for one in made] == [
        ("random", ""), ("round-1", "frcnn-synth"), ("round-2", "hardened-frcnn-synth"),
    ]  # fmt: skip
    image = torch.rand(1, 3, SIZE, SIZE, requires_grad=True)
    hardened.dense(image).classes.sum().backward()
    assert image.grad is not None
    assert image.grad.abs().sum() > 0  # it can be attacked again


def test_mistakes_are_told_before_anything_is_done(data: Dataset, noise: Path, tmp_path: Path) -> None:
    good, out = hardening(data, tmp_path / "out", [noise]), tmp_path / "out"
    stranger = tmp_path / "stranger.json"
    save_camouflage(stranger, Camouflage("x", "tank", "123", 2, "plain"), png_bytes(np.zeros((2, 2, 3), np.uint8)))
    for changed, message in (
        ({"detector": "ssd-mobilenet-v2"}, "ssd-mobilenet-v2: rauca hardens its own detectors.*dataset export"),
        ({"detector": "yolov9"}, "yolov9"),
        ({"camouflages": [stranger]}, "stranger.json: made for UV atlas 123 of tank, which no data set shows"),
        ({"camouflages": [tmp_path / "none.json"]}, "none.json: not found"),
        ({"datasets": [tmp_path]}, "not a data set"),
        ({"camouflages": [], "settings": HardenSettings.make(attack_steps=0)}, "nothing to harden against"),
    ):
        with pytest.raises(RaucaError, match=message):
            harden(replace(good, **changed))
        assert not out.exists() or not any(out.rglob("*.safetensors"))
        assert not (out / "hardening.json").exists()
    write_json(out / "hardening.json", {"format": "rauca-hardening", "version": 1, "identity": None})
    with pytest.raises(RaucaError, match="holds a hardening with another identity;"):
        harden(good)
    for option, value in (("share", 1.0), ("rounds", 0), ("lr", -1.0)):
        with pytest.raises(RaucaError, match=f"{option}: "):
            HardenSettings.make(**{option: value})
