"""Any function is a detector to evaluate: the same detections as the adapter's, and no nonsense let through."""

from __future__ import annotations

import copy
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.contract import RaucaError
from rauca_core.detect import SOURCES, Detections, class_list, load_detector
from rauca_core.detect.frameworks.torchvision_ops import import_torchvision
from tests.published import published_weights

NAMES = ("car", "bus", "tree")
GOOD = {"boxes": np.array([[1.0, 2, 5, 6], [3, 3, 99, 9]]), "scores": np.array([0.3, 0.9]), "labels": np.array([0, 2])}


def found_by(answer: Any, count: int = 1) -> list[Detections]:
    return load_detector(lambda images: answer, names=NAMES).detect(torch.rand(count, 3, 20, 40))


def assert_same(ours: list[Detections], theirs: list[Detections], scores: float = 0.0, pixels: float = 0.0) -> None:
    assert sum(len(one.scores) for one in theirs) > 5
    for one, other in zip(ours, theirs, strict=True):
        assert torch.equal(one.labels, other.labels)
        torch.testing.assert_close(one.scores, other.scores, rtol=0, atol=scores)
        torch.testing.assert_close(one.boxes, other.boxes, rtol=0, atol=pixels)


def with_opencv(cfg: Path, weights: Path, size: int) -> Callable[[Tensor], Any]:
    """YOLOv4-tiny as an OpenCV user runs it, on images of the network's own size."""
    net = cv2.dnn.readNetFromDarknet(str(cfg), str(weights))
    net.setPreferableBackend(cv2.dnn.DNN_BACKEND_OPENCV)

    def detect(images: Tensor) -> Any:
        answers = []
        for image in images.numpy():
            net.setInput(image[None])
            rows = np.concatenate([np.asarray(one) for one in net.forward(net.getUnconnectedOutLayersNames())])
            index, label = np.nonzero(rows[:, 5:] > 0.02)
            scores = rows[index, 5 + label]
            low = (rows[index, :2] - rows[index, 2:4] / 2) * size
            sides = rows[index, 2:4] * size
            kept = cv2.dnn.NMSBoxesBatched(
                np.hstack([low, sides]).tolist(), scores.tolist(), label.tolist(), 0.02, 0.45
            )
            kept = np.asarray(kept, int).reshape(-1)
            answers.append((np.hstack([low, low + sides])[kept], scores[kept], label[kept]))
        return answers

    return detect


def test_opencvs_yolo_finds_what_the_adapter_finds(
    picture: Callable[[int, int], NDArray[np.float32]], tmp_path: Path
) -> None:
    weights, lowered = published_weights("yolov4-tiny")["yolov4-tiny"], tmp_path / "lowered.cfg"
    lowered.write_text(SOURCES["yolov4-tiny"].cfg.read_text().replace("[yolo]", "[yolo]\nthresh=1e-3"))
    images = torch.from_numpy(np.stack([picture(416, 416), picture(416, 416)[::-1]]).transpose(0, 3, 1, 2).copy())
    ours = load_detector(with_opencv(lowered, weights, 416), names=class_list("coco-80")).detect(images, 0.02)
    assert_same(ours, load_detector("yolov4-tiny", 416).detect(images, 0.02), 1e-4, 0.05)


@pytest.mark.skipif(not importlib.util.find_spec("torchvision"), reason="the extra detectors is missing")
def test_torchvisions_model_in_a_function_finds_what_the_adapter_finds() -> None:
    torch.manual_seed(0)
    build = import_torchvision().models.detection.ssdlite320_mobilenet_v3_large
    model = build(weights=None, weights_backbone=None, num_classes=len(NAMES) + 1).eval()

    def detect(images: Tensor) -> Any:
        return [{**one, "labels": [NAMES[label - 1].upper() for label in one["labels"]]} for one in model(list(images))]

    adapter = load_detector(copy.deepcopy(model), names=NAMES)
    images = torch.rand(2, 3, 70, 110)
    theirs = adapter.detect(images, model.score_thresh, model.nms_thresh)
    assert_same(load_detector(detect, names=NAMES).detect(images, model.score_thresh), theirs)


def test_detections_come_best_first_and_inside_the_image() -> None:
    (found,) = found_by([GOOD])
    assert found.scores.tolist() == pytest.approx([0.9, 0.3])
    assert found.labels.tolist() == [2, 0]
    assert found.boxes.tolist() == [[3, 3, 40, 9], [1, 2, 5, 6]]
    assert found.boxes.dtype == found.scores.dtype == torch.float32
    (kept,) = load_detector(lambda images: [GOOD], names=NAMES).detect(torch.rand(1, 3, 20, 40), 0.5)
    assert kept.labels.tolist() == [2]


@pytest.mark.parametrize(
    "answer",
    [
        tuple(GOOD.values()),
        {key: value.tolist() for key, value in GOOD.items()},
        {key: torch.from_numpy(value) for key, value in GOOD.items()},
        GOOD | {"labels": ["Car", "tree"], "masks": None},
        GOOD | {"labels": np.array([0.0, 2.0]), "boxes": GOOD["boxes"].astype(np.float16)},
    ],
)
def test_answers_of_any_library(answer: Any) -> None:
    (expected,), (found,) = found_by([GOOD]), found_by((answer,))
    assert all(torch.equal(*pair) for pair in zip(vars(found).values(), vars(expected).values(), strict=True))


def test_nothing_found() -> None:
    for answer in (([], [], []), {"boxes": np.zeros((0, 4)), "scores": torch.zeros(0), "labels": np.zeros(0, int)}):
        for found in found_by([answer, answer], 2):
            assert (found.boxes.shape, found.scores.shape, found.labels.shape) == ((0, 4), (0,), (0,))


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        (GOOD, "callable: answered 1 images with a dict of boxes, scores, labels; return a list with one dict"),
        ([GOOD, GOOD], "answered 1 images with a list of 2"),
        (np.zeros((1, 6)), r"answered 1 images with a ndarray of shape \(1, 6\)"),
        ([np.zeros((7, 6))], r"image 0 of the batch: answered with a ndarray of shape \(7, 6\); return a dict"),
        ([{"boxes": [], "scores": []}], "answered with a dict of boxes, scores; return"),
        ([GOOD | {"boxes": np.zeros((3, 4))}], r"boxes \(3, 4\), scores \(2,\), labels \(2,\); expected"),
        ([GOOD | {"scores": np.ones((2, 1))}], r"scores \(2, 1\)"),
        ([GOOD | {"labels": [1]}], r"labels \(1,\)"),
        ([GOOD | {"boxes": [[1, 2, 3], [1, 2, 3, 4]]}], "boxes are a list of 2, expected numbers"),
        ([GOOD | {"scores": [0.1, np.nan]}], "NaN or infinite"),
        ([GOOD | {"boxes": np.full((2, 4), np.inf)}], "NaN or infinite"),
        ([GOOD | {"scores": [90, 3]}], r"scores from 3 to 90, expected \[0, 1\]"),
        ([GOOD | {"boxes": [[1, 2, 5, 6], [30, 2, 4, 6]]}], r"box \(30, 2, 4, 6\) ends before it begins"),
        ([GOOD | {"labels": [1, 3]}], "label 3, expected an index into names, 0 to 2; where the network's 0 is"),
        ([GOOD | {"labels": [-1, 0]}], "label -1,"),
        ([GOOD | {"labels": [0.5, 0]}], "label 0.5,"),
        ([GOOD | {"labels": ["car", "lorry"]}], "label 'lorry' is none of the 3 names"),
    ],
)
def test_what_is_no_answer(answers: Any, message: str) -> None:
    with pytest.raises(RaucaError, match=message) as error:
        found_by(answers)
    assert "\n" not in str(error.value)


def test_it_is_asked_in_float32_on_the_cpu_and_without_gradient() -> None:
    asked: list[Any] = []

    def detect(images: Tensor) -> Any:
        asked.append((images.dtype, images.device.type, tuple(images.shape), torch.is_grad_enabled()))
        return [GOOD] * len(images)

    detector = load_detector(detect, names=NAMES)
    detector.detect(torch.rand(2, 3, 20, 40).double().requires_grad_())
    assert asked == [(torch.float32, "cpu", (2, 3, 20, 40), False)]
    assert detector.name == "detect"
    with pytest.raises(RaucaError, match="detect: images must be sRGB in"):
        detector.detect(torch.full((1, 3, 20, 40), 255.0))
    with pytest.raises(RaucaError, match="detect: a callable gives no gradient; attack another detector"):
        detector.dense(torch.rand(1, 3, 20, 40))


def test_its_name_and_fingerprint() -> None:
    def made(**options: Any) -> Any:
        return load_detector(found_by, **{"names": NAMES, **options})

    assert made().fingerprint != made().fingerprint
    assert made(fingerprint="1").fingerprint == made(fingerprint="1").fingerprint
    others = [
        made(fingerprint="2"),
        made(fingerprint="1", names=NAMES[:2]),
        made(fingerprint="1", classes={"bus": "car"}),
    ]
    assert len({one.fingerprint for one in [made(fingerprint="1"), *others]}) == 4
    assert (made(name="mine").name, made(name="mine", classes={"bus": "car"}).name) == ("mine", "mine")
    for options, message in {
        "name": "detector name 'a/b': files bear it",
        "names": "found_by: a callable knows its size but no class names; give names",
        "size": "leave size out",
    }.items():
        with pytest.raises(RaucaError, match=message):
            made(**{options: {"name": "a/b", "names": None, "size": 320}[options]})
    with pytest.raises(RaucaError, match="fingerprint: a network has one by its weights"):
        load_detector("yolov4-tiny", fingerprint="1")
