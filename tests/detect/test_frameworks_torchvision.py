"""torchvision's models with seeded random weights: the real architectures at a small input size."""

from __future__ import annotations

import copy
import importlib.util
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from rauca_core.contract import RaucaError
from rauca_core.detect import box_iou, class_list, load_detector
from rauca_core.detect.families import Resolved
from rauca_core.detect.frameworks.torchvision_detector import TorchvisionDetector, _columns, load
from rauca_core.detect.frameworks.torchvision_ops import import_torchvision
from rauca_core.detect.nms import detections
from tests.detect.gradients import checked_gradient

pytestmark = pytest.mark.skipif(not importlib.util.find_spec("torchvision"), reason="the extra detectors is missing")

NAMES = ("car", "bus", "tree")
SIZE = 96
SMALL = "fasterrcnn_mobilenet_v3_large_320_fpn"
SSD = "ssdlite320_mobilenet_v3_large"
ONE_STAGE = ("retinanet_resnet50_fpn", "fcos_resnet50_fpn", SSD)
Made = dict[str, TorchvisionDetector]
CHECKED = (SMALL, "fasterrcnn_resnet50_fpn", *ONE_STAGE)


def photographs(count: int = 2, height: int = 70, width: int = 110) -> Tensor:
    torch.manual_seed(1)
    coarse = torch.rand(count, 3, 7, 11)
    return nn.functional.interpolate(coarse, (height, width), mode="bicubic").clamp(0, 1)


def class_layers(model: Any) -> list[nn.Module]:
    if hasattr(model, "roi_heads"):
        return [model.roi_heads.box_predictor.cls_score]
    head = model.head.classification_head
    if hasattr(head, "cls_logits"):
        return [head.cls_logits]
    return [[layer for layer in branch.modules() if isinstance(layer, nn.Conv2d)][-1] for branch in head.module_list]


@torch.no_grad()
def sharpen(model: Any) -> None:
    """Center and scale the last layer's random logits, so that they decide between categories."""
    seen: dict[nn.Module, list[Tensor]] = {layer: [] for layer in class_layers(model)}
    hooks = [
        layer.register_forward_hook(lambda *call: seen[call[0]].append(call[2].transpose(0, 1).flatten(1)))
        for layer in seen
    ]
    model(list(photographs()))
    for hook in hooks:
        hook.remove()
    for layer, calls in seen.items():
        logits = torch.cat(calls, 1) - layer.bias[:, None]
        gain = 2 / (logits - logits.mean(1, keepdim=True)).std()
        layer.weight *= gain
        layer.bias.copy_(-gain * logits.mean(1))


@pytest.fixture(scope="module")
def detectors() -> dict[str, TorchvisionDetector]:
    """Each architecture with sharpened random weights, and few proposals for the sake of time."""
    made = {}
    for architecture in CHECKED:
        torch.manual_seed(0)
        build = getattr(import_torchvision().models.detection, architecture)
        model = build(weights=None, weights_backbone=None, num_classes=len(NAMES) + 1).eval()
        if "ssd" not in architecture:
            model.transform.min_size, model.transform.max_size = (SIZE,), round(SIZE * 1333 / 800)
        if hasattr(model, "rpn"):
            model.rpn._post_nms_top_n = {"training": 60, "testing": 60}
        sharpen(model)
        made[architecture] = TorchvisionDetector(architecture, model, NAMES)
    return made


@pytest.fixture(scope="module")
def small_file(detectors: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("weights") / "small.safetensors"
    save_file(detectors[SMALL].network.state_dict(), path)
    return path


@pytest.mark.parametrize("architecture", CHECKED)
def test_detect_is_torchvisions_own_result(architecture: str, detectors: Made) -> None:
    detector = detectors[architecture]
    reference = copy.deepcopy(detector.network)
    limits = getattr(reference, "roi_heads", reference)
    limits.score_thresh, limits.nms_thresh = 0.3, 0.4
    images = photographs()
    with torch.no_grad():
        expected = reference(list(images))
    found = detector.detect(images, 0.3, 0.4)
    assert sum(len(one.scores) for one in found) > 10
    for ours, theirs in zip(found, expected, strict=True):
        kept = theirs["labels"] > 0  # RetinaNet and FCOS have a column for a background that is no category
        assert torch.equal(ours.labels, theirs["labels"][kept] - 1)
        assert torch.equal(ours.boxes, theirs["boxes"][kept])
        assert torch.equal(ours.scores, theirs["scores"][kept])


@pytest.mark.parametrize("architecture", ONE_STAGE)
def test_dense_predictions_after_suppression_are_torchvisions_detections(architecture: str, detectors: Made) -> None:
    detector = detectors[architecture]
    unlimited = TorchvisionDetector("unlimited", copy.deepcopy(detector.network), NAMES)
    unlimited.network.topk_candidates = unlimited.network.detections_per_img = 10**6
    images = photographs()
    with torch.no_grad():
        ours = detections(unlimited.dense(images), 0.6, 0.5)
    for one, other in zip(ours, unlimited.detect(images, 0.6, 0.5), strict=True):
        assert len(one.scores) == len(other.scores) > 3
        assert (one.scores - other.scores).abs().max() < 1e-5
        order, same = (found.boxes.sum(1).argsort() for found in (one, other))  # equal scores come in any order
        assert (one.boxes[order] - other.boxes[same]).abs().max() < 1e-3


@pytest.mark.parametrize("architecture", CHECKED[:2])
def test_every_sure_detection_of_two_stages_is_among_the_dense_ones(architecture: str, detectors: Made) -> None:
    detector = detectors[architecture]
    images = photographs()
    dense = detector.dense(images)
    assert dense.boxes.shape == (*dense.objectness.shape, 4)
    assert set(dense.objectness.unique().tolist()) <= {0.0, 1.0}
    sure = 0
    for index, found in enumerate(detector.detect(images, 0.5, 0.5)):
        for box, score, label in zip(found.boxes, found.scores, found.labels, strict=True):
            same = (dense.boxes[index] - box).abs().amax(1) < 1e-3
            same &= (dense.classes[index, :, label] - score).abs() < 1e-5
            assert (same & (dense.objectness[index] == 1)).any()
            sure += 1
    assert sure > 3


@pytest.mark.parametrize("architecture", CHECKED)
def test_gradients_reach_the_whole_image(architecture: str, detectors: Made) -> None:
    detector = detectors[architecture]
    images = photographs().requires_grad_()
    found = detector.dense(images)
    (found.objectness[..., None] * found.classes).amax((1, 2)).sum().backward()
    assert images.grad is not None
    assert torch.isfinite(images.grad).all()
    assert (images.grad.abs().sum((1, 2, 3)) > 0).all()
    assert all(parameter.grad is None for parameter in detector.network.parameters())
    truth = torch.tensor([[20.0, 20.0, 60.0, 60.0]])
    (boxes_gradient,) = torch.autograd.grad(
        box_iou(detector.dense(images).boxes, truth).amax((1, 2)).sum(), images, allow_unused=False
    )
    assert boxes_gradient.abs().sum() > 0


def test_the_gradient_is_the_derivative(detectors: Made) -> None:
    exact = TorchvisionDetector("exact", copy.deepcopy(detectors[SSD].network), NAMES)
    checked_gradient(exact, photographs(1).clamp(0.1, 0.9), boxes=0.0, step=1e-7, rtol=1e-4)


@pytest.mark.parametrize("shape", [(1, 3, 33, 301), (3, 3, 211, 37), (1, 3, 8, 8), (2, 3, 1, 1)])
def test_any_size_aspect_and_batch(shape: tuple[int, ...], detectors: Made) -> None:
    torch.manual_seed(3)
    images = torch.rand(shape)
    for architecture in (SMALL, "retinanet_resnet50_fpn"):
        detector = detectors[architecture]
        assert len(detector.dense(images).boxes) == shape[0]
        limit = torch.tensor([shape[3], shape[2]] * 2) + 1e-3
        for found in detector.detect(images, 0.2, 0.5):
            assert (found.boxes >= 0).all()
            assert (found.boxes <= limit).all()


def test_nothing_found_is_an_empty_result(detectors: Made) -> None:
    for found in detectors[SMALL].detect(photographs(), 1.0, 0.5):
        assert found.boxes.shape == (0, 4)
        assert found.scores.shape == found.labels.shape == (0,)


def test_images_without_a_pixel_left_are_refused(detectors: Made) -> None:
    for call in (detectors[SMALL].detect, detectors[SMALL].dense):
        with pytest.raises(RaucaError, match="too narrow"):
            call(torch.rand(1, 3, 1, 2000))


def read(path: Path, architecture: str = SMALL, size: int | None = None) -> TorchvisionDetector:
    return load(Resolved("x", "torchvision", (path,), NAMES, architecture), size)


@pytest.fixture(scope="module")
def loaded(small_file: Path) -> TorchvisionDetector:
    return read(small_file, size=SIZE)


def test_the_fingerprint_follows_weights_and_size_only(loaded: TorchvisionDetector, small_file: Path) -> None:
    loaded.detect(photographs())
    assert load_detector(loaded.network, names=NAMES).fingerprint == loaded.fingerprint
    other = copy.deepcopy(loaded.network)
    other.roi_heads.box_predictor.cls_score.bias += 1
    larger = read(small_file, size=SIZE + 32)
    assert len({one.fingerprint for one in (loaded, load_detector(other, names=NAMES), larger)}) == 3


def test_a_model_in_memory_is_copied(detectors: Made) -> None:
    model = copy.deepcopy(detectors[SMALL].network).requires_grad_().train()
    detector = load_detector(model, names=NAMES)
    assert (detector.name, detector.class_names) == ("FasterRCNN", NAMES)
    before = detector.detect(photographs(1))[0]
    assert model.training
    assert all(parameter.requires_grad for parameter in model.roi_heads.parameters())
    nn.init.zeros_(model.roi_heads.box_predictor.cls_score.weight)
    assert torch.equal(before.scores, detector.detect(photographs(1))[0].scores)
    with pytest.raises(RaucaError, match="predicts 3 classes, 2 names"):
        load_detector(model, names=NAMES[:2])
    with pytest.raises(RaucaError, match="FasterRCNN: a model in memory holds no class names; give names"):
        load_detector(model)
    with pytest.raises(RaucaError, match="FasterRCNN: its input size is its own; leave size out"):
        load_detector(model, SIZE, names=NAMES)


def test_weights_that_do_not_fit_are_refused_by_the_first_wrong_tensor(tmp_path: Path, small_file: Path) -> None:
    good = load_file(small_file)
    key = "roi_heads.box_predictor.cls_score.weight"
    cases = {
        "nan": (good | {key: good[key] * float("nan")}, f"{key} holds values that are not finite"),
        "short": ({name: one for name, one in good.items() if name != key}, f"lacks tensor {key}"),
        "long": (good | {"extra.weight": torch.zeros(2)}, "unknown tensor extra.weight"),
        "classes": (good | {key: torch.zeros(91, 1024)}, f"size mismatch for {key}"),
    }
    for name, (state, message) in cases.items():
        save_file(state, tmp_path / f"{name}.safetensors")
        with pytest.raises(RaucaError, match=message) as error:
            read(tmp_path / f"{name}.safetensors")
        assert f"{name}.safetensors" in str(error.value)
        assert "\n" not in str(error.value)
    with pytest.raises(RaucaError, match=r"small\.safetensors: .*tensor"):
        read(small_file, SSD)


class Payload:
    """Unpickling this would run code of the file's choosing."""

    def __reduce__(self) -> tuple[Any, ...]:
        return exec, ("raise SystemExit('ran')",)


def test_weights_say_how_many_classes_they_have(detectors: Made, small_file: Path, tmp_path: Path) -> None:
    """Not the list of names: COCO's 90 are no mistake of the file."""
    for detector in detectors.values():
        assert _columns(detector.network.state_dict()) == len(NAMES) + 1
    with pytest.raises(
        RaucaError, match=r"x: the network predicts 3 classes, 90 names were given; write its own, one a"
    ):
        load(Resolved("x", "torchvision", (small_file,), class_list("coco-91"), SMALL), None)
    small_file.with_suffix(".names").write_text("\n".join(NAMES))
    mine = load_detector(f"{SMALL}={small_file}", SIZE, classes={"tree": "bus"})
    assert (mine.name, mine.class_names) == ("small", ("car", "bus"))
    assert mine.detector.fingerprint == read(small_file, size=SIZE).fingerprint
    build = import_torchvision().models.detection.retinanet_resnet50_fpn
    without_background = build(weights=None, weights_backbone=None, num_classes=len(NAMES))
    save_file(without_background.state_dict(), tmp_path / "three.safetensors")
    found = read(tmp_path / "three.safetensors", "retinanet_resnet50_fpn", SIZE)
    assert found.dense(photographs(1)).classes.shape[2] == len(NAMES)


def test_checkpoints_are_tensors_and_nothing_else(
    tmp_path: Path, loaded: TorchvisionDetector, small_file: Path, detectors: Made
) -> None:
    checkpoint = tmp_path / "checkpoint.pth"
    torch.save({"model": loaded.network.state_dict(), "epoch": 26}, checkpoint)
    assert read(checkpoint, size=SIZE).fingerprint == loaded.fingerprint
    old = {
        name.replace("rpn.head.conv.0.0.", "rpn.head.conv."): one for name, one in loaded.network.state_dict().items()
    }
    torch.save(old, checkpoint)  # the names in which torchvision published its first Faster R-CNN
    assert read(checkpoint, size=SIZE).fingerprint == loaded.fingerprint
    torch.save({"model": Payload()}, checkpoint)
    with pytest.raises(RaucaError, match="objects other than tensors"):
        read(checkpoint)
    torch.save([1, 2], checkpoint)
    with pytest.raises(RaucaError, match="no tensors by name"):
        read(checkpoint)
    for name in ("cut.safetensors", "cut.pth"):
        (tmp_path / name).write_bytes(small_file.read_bytes()[:5000])
        with pytest.raises(RaucaError, match=rf"{name}: cannot be read as weights|{name}: holds objects"):
            read(tmp_path / name)
    with pytest.raises(RaucaError, match="not found"):
        read(tmp_path / "absent.pth")
    torch.save(detectors[SSD].network.state_dict(), checkpoint)
    with pytest.raises(RaucaError, match="leave size out"):
        read(checkpoint, SSD, 640)
