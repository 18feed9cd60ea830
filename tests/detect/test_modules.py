"""Any module of torchvision's convention: eager, scripted, exported; the same network as ONNX, module and function."""

from __future__ import annotations

import copy
import importlib.util
import warnings
from pathlib import Path
from typing import Any, Dict, List  # noqa: UP035  TorchScript knows no other

import pytest
import torch
from torch import Tensor, nn

from rauca_core.attack.ensemble import DetectorEnsemble
from rauca_core.contract import RaucaError
from rauca_core.detect import DensePredictions, Detections, load_detector
from rauca_core.detect.frameworks.module_detector import ModuleDetector
from rauca_core.detect.nms import corners, detections
from tests.detect.gradients import checked_gradient

NAMES = ("car", "bus", "tree")
SIZE = 64


class Small(nn.Module):
    """A class and a box for each field of 8 x 8 pixels, the twelve surest ones."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.Sequential(nn.Conv2d(3, 7, 8, 8), nn.BatchNorm2d(7))

    def forward(self, images: List[Tensor]) -> List[Dict[str, Tensor]]:  # noqa: UP006
        found: List[Dict[str, Tensor]] = []  # noqa: UP006
        for image in images:
            x = self.body(image[None])[0].flatten(1).t()
            scores, order = x[:, 4:].sigmoid().amax(1).topk(12)
            low = x[order, :2].sigmoid() * 30
            boxes = torch.cat([low, low + 1 + x[order, 2:4].sigmoid() * 30], 1)
            found.append({"boxes": boxes, "scores": scores, "labels": x[order, 4:].argmax(1)})
        return found


class Blind(Small):
    @torch.no_grad()
    def forward(self, images: Any) -> Any:
        return super().forward(images)


class Upright(Small):
    """Another program with the same weights and structure."""

    def forward(self, images: Any) -> Any:
        return [{**one, "scores": one["scores"] / 2} for one in super().forward(images)]


def small_network() -> Small:
    """With seeded weights."""
    torch.manual_seed(0)
    model = Small().eval()
    nn.init.normal_(model.body[0].weight, std=0.3)
    model.body[1].running_var.mul_(2)
    return model


small = pytest.fixture(scope="module")(small_network)


def photographs(count: int = 2, height: int = SIZE, width: int = SIZE) -> Tensor:
    return torch.rand(count, 3, height, width, generator=torch.Generator().manual_seed(1))


def scripted(model: nn.Module) -> Any:
    with warnings.catch_warnings(action="ignore"):
        return torch.jit.script(model)


def exported(model: nn.Module) -> Any:
    with warnings.catch_warnings(action="ignore"):
        return torch.export.export(model, ([torch.rand(3, SIZE, SIZE)],))


def assert_same(ours: Any, theirs: Any, scores: float = 1e-5, pixels: float = 1e-3) -> None:
    assert sum(len(one.scores) for one in theirs) > 10
    for one, other in zip(ours, theirs, strict=True):
        assert torch.equal(one.labels, other.labels)
        torch.testing.assert_close(one.scores, other.scores, rtol=0, atol=scores)
        torch.testing.assert_close(one.boxes, other.boxes, rtol=0, atol=pixels)


def test_what_it_reports_is_what_is_detected(small: Small) -> None:
    model = copy.deepcopy(small).train()
    detector, images = load_detector(model, names=NAMES), photographs(2, 70, 110)
    assert model.training
    assert (detector.name, detector.class_names) == ("Small", NAMES)
    nn.init.zeros_(model.body[0].weight)  # the detector has its own copy
    found = detector.detect(images)
    for ours, theirs in zip(found, small(list(images)), strict=True):
        assert torch.equal(ours.labels, theirs["labels"])
        torch.testing.assert_close(ours.scores, theirs["scores"])
        torch.testing.assert_close(ours.boxes, theirs["boxes"])
    middle = found[0].scores.median().item()
    assert len(detector.detect(images, middle)[0].scores) == (found[0].scores > middle).sum()


def test_an_attack_goes_through_the_final_scores(small: Small) -> None:
    detector, images = load_detector(small, names=NAMES), photographs().requires_grad_()
    found = detector.dense(images)
    assert (found.boxes.shape, found.objectness.shape, found.classes.shape) == ((2, 12, 4), (2, 12), (2, 12, 3))
    assert_same(detections(found, 0.0, 1.0), detector.detect(images, 0.0))
    for value in (found.classes.sum(), found.boxes.sum()):
        (gradient,) = torch.autograd.grad(value, images, retain_graph=True)
        assert (gradient.abs().sum((1, 2, 3)) > 0).all()
    checked_gradient(load_detector(small, names=NAMES), photographs(1), rtol=1e-4)
    attacked = DetectorEnsemble([detector], "car").attack(photographs(1), torch.tensor([[0.0, 0, 40, 40]]))
    assert attacked.gradient.abs().sum() > 0


def test_images_are_fitted_into_a_square(small: Small) -> None:
    detector, images = load_detector(small, SIZE, names=NAMES), photographs(1, 48, 96)
    assert detector.fingerprint != load_detector(small, names=NAMES).fingerprint
    (found,) = detector.detect(images, 0.0)
    assert found.boxes.shape == (12, 4)
    (fitted,) = load_detector(small, names=NAMES).detect(
        nn.functional.pad(nn.functional.interpolate(images, (32, 64), mode="bilinear"), (0, 0, 16, 16), value=0.5), 0.0
    )
    expected = (fitted.boxes - torch.tensor([0, 16, 0, 16])) * 1.5
    torch.testing.assert_close(found.boxes, expected.clamp(min=0).minimum(torch.tensor([96, 48, 96, 48])))


def test_without_a_gradient_it_is_evaluated_alone(small: Small) -> None:
    blind = Blind().eval()
    blind.load_state_dict(small.state_dict())
    detector = load_detector(blind, names=NAMES)
    assert_same(detector.detect(photographs()), load_detector(small, names=NAMES).detect(photographs()))
    assert detector.dense(photographs()).boxes.shape == (2, 12, 4)
    with pytest.raises(RaucaError, match=r"Blind: its scores have no gradient .*attack another detector") as error:
        detector.dense(photographs().requires_grad_())
    assert "\n" not in str(error.value)


def test_the_fingerprint_follows_weights_and_program(small: Small) -> None:
    upright = Upright().eval()
    upright.load_state_dict(small.state_dict())
    other = copy.deepcopy(small)
    other.body[0].bias.data[0] += 1
    kinds = [small, upright, other, scripted(small), scripted(other), exported(small)]
    made = [load_detector(kind, SIZE, names=NAMES).fingerprint for kind in kinds]
    assert len(set(made)) == len(kinds)
    assert made == [load_detector(kind, SIZE, names=NAMES).fingerprint for kind in kinds]
    assert load_detector(small, SIZE, names=NAMES[::-1]).fingerprint != made[0]


def test_modules_of_another_kind_are_met_when_loaded(small: Small) -> None:
    for model, message in {
        nn.Linear(1, 1): r"Linear: cannot be called with a list of images \(3, 320, 320\)",
        nn.Identity(): "Identity: image 0 of the batch: answered with a Tensor of shape",
        small: "Small: a model in memory holds no class names; give names",
    }.items():
        with pytest.raises(RaucaError, match=message) as error:
            load_detector(model, names=None if model is small else NAMES)
        assert "\n" not in str(error.value)
    with pytest.raises(RaucaError, match=r"label 2, expected an index into names, 0 to 1"):
        load_detector(small, names=NAMES[:2])
    holder = copy.deepcopy(small)
    holder.stream = (line for line in "")
    with pytest.raises(RaucaError, match=r"Small: cannot be copied .*load a function that calls it"):
        load_detector(holder, names=NAMES)


@pytest.fixture
def archive(small: Small, tmp_path: Path) -> Path:
    path = tmp_path / "mine.torchscript"
    scripted(small).save(str(path))
    path.with_suffix(".names").write_text("\n".join(NAMES))
    return path


def test_archives_of_torchscript(small: Small, archive: Path) -> None:
    here, images = load_detector(small, names=NAMES), photographs()
    checkpoint = archive.with_name("mine.pt")
    checkpoint.write_bytes(archive.read_bytes())
    for path in (archive, checkpoint):
        detector = load_detector(path)
        assert (detector.name, detector.class_names) == ("mine", NAMES)
        assert_same(detector.detect(images), here.detect(images))
        wanted = images.clone().requires_grad_()
        detector.dense(wanted).classes.sum().backward()
        assert wanted.grad is not None
        reference = images.clone().requires_grad_()
        here.dense(reference).classes.sum().backward()
        torch.testing.assert_close(wanted.grad, reference.grad)
    assert load_detector(archive).fingerprint == load_detector(checkpoint).fingerprint
    assert load_detector(archive).fingerprint != load_detector(archive, SIZE).fingerprint
    assert load_detector(archive, names="abc", classes={"a": "car"}).class_names == ("car", "b", "c")
    archive.with_suffix(".names").unlink()
    with pytest.raises(RaucaError, match=r"mine: no class names; write them, one per line, into a \.names file"):
        load_detector(archive)


class Writer(Small):
    def forward(self, images: List[Tensor]) -> List[Dict[str, Tensor]]:  # noqa: UP006
        torch.save(images[0], "loot")
        return [{"boxes": torch.zeros(0, 4), "scores": torch.zeros(0), "labels": torch.zeros(0)} for _ in images]


def test_archives_that_do_more_than_compute(tmp_path: Path, archive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    scripted(Writer()).save("writer.torchscript")
    with pytest.raises(RaucaError, match=r"writer.torchscript: its program says 'save', which may reach files"):
        load_detector("writer.torchscript", names=NAMES)
    assert not Path("loot").exists()
    torch.save({"weight": torch.zeros(2)}, "pickle.torchscript")
    with pytest.raises(RaucaError, match=r"pickle.torchscript: is no TorchScript archive"):
        load_detector("pickle.torchscript", names=NAMES)
    # A flipped bit says that a part's name is UTF-8, and another one that it is not.
    whole = bytearray(archive.read_bytes())
    local = whole.rindex(b"PK\x03\x04", 0, whole.index(b".py"))
    whole[local + 7] |= 8
    whole[local + 30] = 0x9D
    Path("name.torchscript").write_bytes(whole)
    with pytest.raises(RaucaError, match=r"name.torchscript: cannot be read as TorchScript"):
        load_detector("name.torchscript", names=NAMES)
    Path("cut.torchscript").write_bytes(archive.read_bytes()[:5000])
    with pytest.raises(RaucaError, match=r"cut.torchscript: is no TorchScript archive"):
        load_detector("cut.torchscript", names=NAMES)
    torch.save({"weight": torch.zeros(2)}, "pickle.pt")
    with pytest.raises(RaucaError, match=r"pickle\.pt"):
        load_detector("pickle.pt", names=NAMES)


def test_programs_of_torch_export(small: Small, tmp_path: Path) -> None:
    """They are made for one size and one image; others are fitted, and shown one after another."""
    program, images = exported(small), photographs(3)
    here = load_detector(small, names=NAMES)
    for given in (program, program.module()):
        detector = load_detector(given, SIZE, names=NAMES)
        assert_same(detector.detect(images), here.detect(images))
        wanted = images.clone().requires_grad_()
        detector.dense(wanted).classes.sum().backward()
        assert wanted.grad is not None
        assert (wanted.grad.abs().sum((1, 2, 3)) > 0).all()
    with pytest.raises(RaucaError, match=r"cannot be called with a list of images \(3, 320, 320\)"):
        load_detector(program, names=NAMES)
    path = tmp_path / "mine.pt2"
    torch.export.save(program, path)
    with pytest.raises(
        RaucaError, match=r"mine.pt2: torch's reader .*: load_detector\(torch.export.load\('.*mine.pt2'\)"
    ):
        load_detector(path, names=NAMES)


def test_scripted_models_of_torchvision_count_from_one(small: Small) -> None:
    """Their 0 is the background, and they put out their losses first."""

    class SSD(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.inner, self.original_name = small, "SSD"

        def forward(self, images: Any) -> Any:
            return {}, [{**one, "labels": one["labels"] + 1} for one in self.inner(images)]

    detector, images = load_detector(SSD(), names=NAMES), photographs()
    assert detector.class_names == ("background", *NAMES)
    for ours, theirs in zip(detector.detect(images), load_detector(small, names=NAMES).detect(images), strict=True):
        assert torch.equal(ours.labels, theirs.labels + 1)


@pytest.mark.skipif(not importlib.util.find_spec("onnx"), reason="the extra detectors is missing")
def test_the_same_network_as_onnx_as_module_and_as_function(tmp_path: Path) -> None:
    """Seeded weights, one picture: the same boxes to a hundredth of a pixel and scores to 1e-4, whatever runs it."""
    import onnxruntime

    from tests.detect.onnx.conftest import NAMES as LISTED
    from tests.detect.onnx.conftest import V8, export

    network, path, names = V8(), export("v8", tmp_path / "v8.onnx", SIZE), tuple(LISTED.values())
    torch.manual_seed(0)
    for parameter in network.parameters():  # as they were exported
        nn.init.normal_(parameter, std=0.3)

    def decoded(output: Tensor) -> list[Detections]:
        rows = output.transpose(1, 2)
        found = DensePredictions(corners(rows[..., :4]), torch.ones_like(rows[..., 0]), rows[..., 4:])
        return detections(found, 0.005, 0.45)

    class Convention(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.network = network

        def forward(self, images: Any) -> Any:
            return [vars(one) for one in decoded(self.network(torch.stack(images)))]

    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])

    def function(images: Tensor) -> Any:
        outputs = [session.run(None, {"images": image[None].numpy()})[0] for image in images]
        found = [decoded(torch.from_numpy(one))[0] for one in outputs]
        return [(one.boxes.numpy(), one.scores.numpy(), [names[label] for label in one.labels]) for one in found]

    images = photographs(2)
    graph = load_detector(path).detect(images)
    module = load_detector(Convention(), names=names)
    assert isinstance(module, ModuleDetector)
    assert_same(module.detect(images), graph, 1e-4, 1e-2)
    assert_same(load_detector(function, names=names).detect(images), graph, 1e-4, 1e-2)
