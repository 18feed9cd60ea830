"""ONNX detectors against onnxruntime, onnx's own evaluator, and the exporters' formulas written out in NumPy."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from numpy.typing import NDArray
from onnx.reference import ReferenceEvaluator

from rauca_core.contract import RaucaError
from rauca_core.detect import class_index, load_detector
from rauca_core.detect.onnx_detector import OnnxDetector
from tests.detect.gradients import checked_gradient

Picture = Callable[[int, int], NDArray[np.float32]]
Array = NDArray[np.float32]


def batch_of(image: Array) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(image.transpose(2, 0, 1)[None]))


def rows(detector: OnnxDetector, images: torch.Tensor) -> Array:
    """(N, 4 + 1 + C)."""
    found = detector.dense(images)
    return torch.cat([found.boxes[0], found.objectness[0, :, None], found.classes[0]], 1).detach().numpy()


def yolox_reference(path: Path, image: Array) -> Array:
    """YOLOX's own preparation and post-processing: resize into the top left corner of a grey square, BGR in 0..255."""
    height, width, _ = image.shape
    ratio = min(416 / height, 416 / width)
    fitted = np.full((416, 416, 3), 114, np.float32)
    inner = cv2.resize(image * 255, (int(width * ratio), int(height * ratio)), interpolation=cv2.INTER_LINEAR)
    fitted[: inner.shape[0], : inner.shape[1]] = inner
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    fed = np.ascontiguousarray(fitted[..., ::-1].transpose(2, 0, 1)[None])
    (found,) = session.run(None, {"images": fed})
    found = found[0].copy()
    row = 0
    for stride in (8, 16, 32):
        for y in range(416 // stride):
            for x in range(416 // stride):
                center_x, center_y = (found[row, 0] + x) * stride, (found[row, 1] + y) * stride
                half_w, half_h = math.exp(found[row, 2]) * stride / 2, math.exp(found[row, 3]) * stride / 2
                found[row, :4] = (center_x - half_w, center_y - half_h, center_x + half_w, center_y + half_h)
                row += 1
    # YOLOX divides by the ratio although its resize rounded a side down: up to 0.5 % off, which nobody wants to copy.
    found[:, 0:4:2] *= width / inner.shape[1]
    found[:, 1:4:2] *= height / inner.shape[0]
    return found


@pytest.mark.parametrize(("height", "width"), [(416, 416), (300, 400), (520, 208)])
def test_yolox_nano_agrees_with_its_own_post_processing(
    height: int, width: int, yolox_nano: Path, picture: Picture
) -> None:
    image = picture(height, width)
    detector = load_detector(f"yolox-nano={yolox_nano}")
    theirs = yolox_reference(yolox_nano, image)
    for wants_gradient in (False, True):  # onnxruntime, torch
        ours = rows(detector, batch_of(image).requires_grad_(wants_gradient))
        assert ours.shape == (3549, 85)
        np.testing.assert_allclose(ours[:, 4:], theirs[:, 4:], atol=1e-4)
        np.testing.assert_allclose(ours[:, :4], theirs[:, :4], atol=0.02, rtol=1e-4)  # pixels
    assert theirs[:, 5:].max() > 0.1


def ultralytics_reference(path: Path, image: Array, size: int, v8: bool) -> Array:
    """Ultralytics' letterbox and scaling back, the graph run by onnx's own evaluator in NumPy."""
    height, width, _ = image.shape
    ratio = min(size / height, size / width)
    new_w, new_h = round(width * ratio), round(height * ratio)
    dw, dh = (size - new_w) / 2, (size - new_h) / 2
    left, right = round(dw - 0.1), round(dw + 0.1)
    top, bottom = round(dh - 0.1), round(dh + 0.1)
    fitted = cv2.resize(image, (new_w, new_h), interpolation=cv2.INTER_LINEAR)
    grey = (114 / 255,) * 3
    fitted = cv2.copyMakeBorder(fitted, top, bottom, left, right, cv2.BORDER_CONSTANT, value=grey)
    (found,) = ReferenceEvaluator(onnx.load(path)).run(None, {"images": fitted.transpose(2, 0, 1)[None]})
    found = found[0].T if v8 else found[0]
    center, extent = found[:, 0:2], found[:, 2:4]
    boxes = np.concatenate([center - extent / 2, center + extent / 2], 1)
    boxes -= (left, top, left, top)
    boxes /= (new_w / width, new_h / height, new_w / width, new_h / height)
    objectness = np.ones_like(found[:, :1]) if v8 else found[:, 4:5]
    return np.concatenate([boxes, objectness, found[:, 4 if v8 else 5 :]], 1)


@pytest.mark.parametrize("kind", ["v5", "v8"])
@pytest.mark.parametrize(("height", "width"), [(64, 64), (90, 51)])
def test_ultralytics_exports_agree_with_numpy(
    kind: str, height: int, width: int, exported: Callable[..., Path], picture: Picture
) -> None:
    image, path = picture(height, width), exported(kind)
    detector = load_detector(str(path))
    assert detector.class_names == ("boat", "Car", "aeroplane")
    assert (class_index(detector, "car"), class_index(detector, "airplane")) == (1, 2)
    theirs = ultralytics_reference(path, image, 64, kind == "v8")
    for wants_gradient in (False, True):
        ours = rows(detector, batch_of(image).requires_grad_(wants_gradient))
        assert ours.shape == ((84 if kind == "v8" else 252), 8)
        np.testing.assert_allclose(ours, theirs, atol=1e-3)


@pytest.mark.parametrize("kind", ["yolox", "v5", "v8"])
def test_gradient_is_the_direction_of_change(
    kind: str, exported: Callable[..., Path], yolox_nano: Path, picture: Picture
) -> None:
    detector = load_detector(f"yolox-nano={yolox_nano}" if kind == "yolox" else str(exported(kind)))
    assert detector.differentiable
    checked_gradient(detector, batch_of(picture(60, 44)).clamp(0.01, 0.99), rtol=1e-4, atol=1e-5)


def test_weights_of_16_bits_leave_the_input_as_it_is(exported: Callable[..., Path], picture: Picture) -> None:
    """Most such exports keep an input of float32; onnxruntime then goes on with what is without gradients."""
    detector = load_detector(str(exported("v8")))
    images = batch_of(picture(60, 44))
    before = detector.dense(images)
    detector.network.half()
    torch.testing.assert_close(detector.dense(images).boxes, before.boxes, atol=0, rtol=0)


@pytest.mark.parametrize("open_batch", [False, True])
def test_images_of_a_batch_do_not_meet(open_batch: bool, exported: Callable[..., Path], picture: Picture) -> None:
    detector = load_detector(str(exported("v8", open_batch=open_batch)))
    images = torch.cat([batch_of(picture(64, 48)), batch_of(picture(64, 48)).flip(3), torch.zeros(1, 3, 64, 48)])
    for wants_gradient in (False, True):
        together = detector.dense(images.clone().requires_grad_(wants_gradient))
        for index in range(3):
            alone = detector.dense(images[index : index + 1])
            torch.testing.assert_close(together.boxes[index], alone.boxes[0], atol=1e-3, rtol=1e-5)
            torch.testing.assert_close(together.classes[index], alone.classes[0], atol=1e-5, rtol=1e-5)
    assert len(detector.detect(images)) == 3


def test_the_best_detection_is_the_best_prediction(exported: Callable[..., Path], picture: Picture) -> None:
    detector = load_detector(str(exported("v5")))
    images = batch_of(picture(64, 64))
    found, (final,) = detector.dense(images), detector.detect(images, score_threshold=0.0)
    scores = found.objectness[0, :, None] * found.classes[0]
    assert float(final.scores[0]) == pytest.approx(float(scores.max()))
    assert int(final.labels[0]) == int(scores.max(0).values.argmax())
    assert final.boxes.min() >= 0
    assert final.boxes.max() <= 64


def test_the_fingerprint_follows_the_file(exported: Callable[..., Path], tmp_path: Path) -> None:
    first, second = load_detector(str(exported("v5"))), load_detector(str(exported("v8")))
    copy = tmp_path / "another-name.onnx"
    copy.write_bytes(exported("v5").read_bytes())
    assert first.fingerprint == load_detector(str(copy)).fingerprint != second.fingerprint
    copy.with_suffix(".names").write_text("car\nboat\naeroplane\n")
    assert first.fingerprint != load_detector(str(copy)).fingerprint


def test_an_operator_that_torch_lacks_leaves_detections(exported: Callable[..., Path], tmp_path: Path) -> None:
    """Shrink with a threshold of 0 changes nothing; onnxruntime has it, onnx2torch does not."""
    model = onnx.load(exported("v8"))
    node = onnx.helper.make_node("Shrink", ["output0"], ["shrunk"], lambd=0.0, bias=0.0)
    model.graph.node.append(node)
    model.graph.output[0].name = "shrunk"
    path = tmp_path / "shrink.onnx"
    onnx.save(model, path)
    detector, whole = load_detector(str(path)), load_detector(str(exported("v8")))
    assert not detector.differentiable
    images = torch.rand(2, 3, 64, 64)
    torch.testing.assert_close(detector.dense(images).boxes, whole.dense(images).boxes)
    assert len(detector.detect(images)) == 2
    with pytest.raises(RaucaError, match=r"has no gradients; .*shrink\.onnx: onnx2torch cannot convert .*Shrink"):
        detector.dense(images.requires_grad_())
