"""Every kind of export that users have: recognized, read as onnxruntime computes it, attacked or refused in a line."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from torch import Tensor

from rauca_core.contract import RaucaError
from rauca_core.detect import load_detector
from rauca_core.detect.onnx_detector import OnnxDetector
from tests.detect.gradients import checked_gradient

Exported = Callable[..., Path]
# kind of the file, options of its export, what it is recognized as
READ = [
    ("v5", {}, "YOLOv5 or v7"),
    ("v8", {"opset": 20}, "YOLOv8, 11, 12 or 26"),
    ("yolox", {"metadata": False, "names": True}, "YOLOX"),
    ("yolox-decoded", {"metadata": False, "names": True}, "YOLOX, decoded"),
    ("detr", {"metadata": False, "names": True}, "DETR, softmax with a last background"),
    ("rt-detr", {"metadata": False, "names": True}, "DETR, a sigmoid per class"),
    ("rf-detr", {"metadata": False, "names": True}, "DETR, a sigmoid per class"),
    ("rt-detr-ultralytics", {}, "RT-DETR of Ultralytics"),
]


def loaded(path: Path) -> OnnxDetector:
    detector = load_detector(str(path))
    assert isinstance(detector, OnnxDetector)
    return detector


def pictures(count: int = 2, height: int = 64, width: int = 64) -> Tensor:
    return torch.rand(count, 3, height, width, generator=torch.Generator().manual_seed(5))


def run(path: Path, *fed: Tensor) -> list[Tensor]:
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    inputs = {value.name: one.numpy() for value, one in zip(session.get_inputs(), fed, strict=True)}
    return [torch.from_numpy(np.asarray(one)) for one in session.run(None, inputs)]


@pytest.mark.parametrize(
    ("kind", "options", "known_as"), READ, ids=lambda value: value if isinstance(value, str) else ""
)
def test_an_export_is_recognized_and_can_be_attacked(
    kind: str, options: dict, known_as: str, exported: Exported
) -> None:
    detector = loaded(exported(kind, **options))
    assert detector.kind == known_as
    assert detector.class_names == ("boat", "Car", "aeroplane")
    assert detector.differentiable
    images = pictures(2, 60, 44)
    plain, found = detector.dense(images), detector.dense(images.clone().requires_grad_())  # onnxruntime, torch
    torch.testing.assert_close(found.boxes, plain.boxes, atol=1e-2, rtol=1e-4)
    torch.testing.assert_close(found.classes, plain.classes, atol=1e-4, rtol=1e-4)
    assert len(detector.detect(images, score_threshold=0.0)[0].scores) > 0
    checked_gradient(detector, images.clamp(0.01, 0.99), rtol=1e-4, atol=1e-5)


def test_a_decoded_yolox_is_the_raw_one(exported: Exported) -> None:
    raw, decoded = (
        loaded(exported(kind, metadata=False, names=True)).dense(pictures()) for kind in ("yolox", "yolox-decoded")
    )
    torch.testing.assert_close(decoded.boxes, raw.boxes, atol=1e-2, rtol=1e-4)
    torch.testing.assert_close(decoded.classes, raw.classes)
    with pytest.raises(RaucaError, match=r"v8.onnx: gives output0 .* not YOLOX's .*export_onnx.py"):
        load_detector(f"yolox={exported('v8')}")
    assert loaded(exported("yolox", metadata=False, names=True)).fingerprint == (
        load_detector(f"yolox={exported('yolox', metadata=False, names=True)}").fingerprint
    )


def test_logits_of_detr(exported: Exported) -> None:
    """Softmax where a column is left over, a sigmoid where none is; normalization and boxes of whole images."""
    images = pictures(1)
    mean, std = (torch.tensor(v).view(3, 1, 1) for v in ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225)))
    for kind, fed in (("detr", (images - mean) / std), ("rt-detr", images), ("rf-detr", (images - mean) / std)):
        path = exported(kind, metadata=False, names=True)
        boxes, logits = run(path, fed)[:2][:: 1 if kind == "rf-detr" else -1]
        found = loaded(path).dense(images)
        expected = logits.softmax(2)[..., :3] if kind == "detr" else logits.sigmoid()[..., :3]
        torch.testing.assert_close(found.classes, expected, atol=1e-5, rtol=1e-5)
        torch.testing.assert_close((found.boxes[..., :2] + found.boxes[..., 2:]) / 2, boxes[..., :2] * 64)


def test_what_lies_beside_detr_decides(exported: Exported, tmp_path: Path) -> None:
    """As Optimum writes it: the model's type, its names, and how images are prepared."""
    path = tmp_path / "model.onnx"
    path.write_bytes(exported("rt-detr", metadata=False).read_bytes())
    with pytest.raises(
        RaucaError, match=r"model.onnx: predicts 3 columns of classes, no names are known; write .*3 if each"
    ):
        load_detector(str(path))
    (tmp_path / "config.json").write_text('{"model_type": "rt_detr", "id2label": {"0": "a", "1": "car", "2": "b"}}')
    before = loaded(path)
    assert before.class_names == ("a", "car", "b")
    (tmp_path / "preprocessor_config.json").write_text(
        '{"image_mean": [0.5, 0.5, 0.5], "image_std": [0.5, 0.5, 0.5], "size": {"height": 64, "width": 64}}'
    )
    images, after = pictures(), loaded(path)
    torch.testing.assert_close(after.dense(images).classes, run(path, images[:1] * 2 - 1)[0].sigmoid().new_tensor(
        torch.cat([run(path, one[None] * 2 - 1)[0].sigmoid() for one in images]).tolist()
    ), atol=1e-5, rtol=1e-5)  # fmt: skip
    assert before.fingerprint != after.fingerprint
    folder = load_detector(str(tmp_path))
    assert (folder.name, folder.fingerprint) == (tmp_path.name, after.fingerprint)


REMEDIES = {
    "end2end": "yolo export model=.*end2end.pt format=onnx end2end=False",
    "rt-detr-final": "pip install 'ultralytics<8.4' && yolo export",
    "rt-detr-own": "optimum-cli",
}


@pytest.mark.parametrize("kind", REMEDIES)
def test_final_detections_are_taken_as_they_are(kind: str, exported: Exported) -> None:
    """Neither suppressed again nor lost on the way; an attack is told why not, and the command."""
    path = exported(kind, metadata=kind != "rt-detr-own", names=True)
    detector, images = loaded(path), pictures(1)
    found = run(path, images, torch.tensor([[64, 64]])) if kind == "rt-detr-own" else run(path, images)
    if kind == "rt-detr-own":
        labels, boxes, scores = (one[0] for one in found)
    else:
        boxes, scores, labels = found[0][0, :, :4], found[0][0, :, 4], found[0][0, :, 5]
    if kind == "rt-detr-final":
        boxes = 64 * torch.cat([boxes[:, :2] - boxes[:, 2:] / 2, boxes[:, :2] + boxes[:, 2:] / 2], 1)
    threshold = float(scores.median())
    order = scores.argsort(descending=True)[: int((scores > threshold).sum())]
    (final,) = detector.detect(images, score_threshold=threshold, iou_threshold=0.01)
    torch.testing.assert_close(final.scores, scores[order])
    assert final.labels.tolist() == labels[order].long().tolist()
    torch.testing.assert_close(final.boxes, boxes[order].clamp(0, 64))
    wide = torch.nn.functional.pad(images, (0, 0, 32, 32), value=114 / 255)  # 128 x 64: halved, grey at both sides
    assert len(detector.detect(wide, score_threshold=0.0)[0].boxes) > 0
    for wanted in (images, images.clone().requires_grad_()):
        with pytest.raises(
            RaucaError, match=rf"^{kind}: has no gradients; .*its own choice .*`{REMEDIES[kind]}"
        ) as caught:
            detector.dense(wanted)
        assert "\n" not in str(caught.value)


def test_final_detections_without_names(exported: Exported) -> None:
    with pytest.raises(RaucaError, match=r"end2end.onnx: class names are not in it; write .*end2end.names"):
        load_detector(str(exported("end2end", metadata=False)))


@pytest.mark.parametrize("kind", ["v5", "v8", "yolox", "end2end"])
@pytest.mark.parametrize(
    "options", [{"size": (64, 96)}, {"batch": 4}, {"open_batch": True}, {"open_size": True}], ids=str
)
def test_any_size_and_batch(kind: str, options: dict, exported: Exported) -> None:
    """A rectangle is filled as far as the picture's aspect lets it; a batch is cut and filled up as the file wants."""
    made = exported(kind, **options, metadata=kind != "yolox", names=True)
    detector, images = loaded(made), pictures(3, 48, 96)
    unknown = "open_size" in options and kind == "yolox"  # Ultralytics' metadata say what an open size was
    assert detector.shape == ((640, 640) if unknown else options.get("size", (64, 64)))
    found = detector.detect(images, score_threshold=0.0)
    for index, one in enumerate(found):
        (alone,) = detector.detect(images[index : index + 1], score_threshold=0.0)
        torch.testing.assert_close(one.scores, alone.scores, atol=1e-5, rtol=1e-5)
        torch.testing.assert_close(one.boxes, alone.boxes, atol=1e-2, rtol=1e-4)
    if kind == "end2end":
        return
    gradient = images.clone().requires_grad_()
    detector.dense(gradient).classes.sum().backward()
    assert gradient.grad is not None
    assert (gradient.grad.flatten(1).abs().sum(1) > 0).all()
    torch.testing.assert_close(detector.dense(gradient).boxes, detector.dense(images).boxes, atol=1e-2, rtol=1e-4)


def test_a_rectangle_is_not_stretched(exported: Exported) -> None:
    path = exported("v8", size=(64, 96))
    images = pictures(1, 64, 96)
    boxes = run(path, images)[0][0, :4].T
    found = loaded(path).dense(images).boxes[0]
    torch.testing.assert_close((found[:, 2:] + found[:, :2]) / 2, boxes[:, :2], atol=1e-3, rtol=1e-5)
    small = torch.nn.functional.interpolate(images, (32, 48), mode="area")
    fitted = torch.nn.functional.interpolate(small, (64, 96), mode="bilinear", align_corners=False)
    torch.testing.assert_close(
        loaded(path).dense(small).boxes * 2, loaded(path).dense(fitted).boxes, atol=1e-2, rtol=1e-4
    )


def test_another_task_of_ultralytics(exported: Exported, tmp_path: Path) -> None:
    """Masks beside the boxes do no harm; boxes that are turned do."""
    model = onnx.load(exported("v8"))
    for task, path in (("segment", tmp_path / "segment.onnx"), ("obb", tmp_path / "obb.onnx")):
        onnx.helper.set_model_props(model, {"task": task, "names": "{0: 'car', 1: 'boat'}"})  # the third is a mask's
        onnx.save(model, path)
    assert loaded(tmp_path / "segment.onnx").dense(pictures()).classes.shape[2] == 2
    with pytest.raises(RaucaError, match=r"obb.onnx: exported for the task 'obb'"):
        load_detector(str(tmp_path / "obb.onnx"))


def test_an_export_of_16_bits_is_evaluated(exported: Exported, tmp_path: Path) -> None:
    """As `half=True` makes it: images go in as 16 bits; an attack is told to export it again."""
    model = onnx.load(exported("v8"))
    model.graph.input[0].type.tensor_type.elem_type = onnx.TensorProto.FLOAT16
    for node in model.graph.node:
        node.input[:] = ["whole" if name == "images" else name for name in node.input]
    model.graph.node.insert(0, onnx.helper.make_node("Cast", ["images"], ["whole"], to=onnx.TensorProto.FLOAT))
    onnx.save(model, tmp_path / "half.onnx")
    half, whole = loaded(tmp_path / "half.onnx"), loaded(exported("v8"))
    images = pictures().half().float()
    torch.testing.assert_close(half.dense(images).boxes, whole.dense(images).boxes)
    with pytest.raises(RaucaError, match="computes in 16 bits; export it with half=False"):
        half.dense(images.requires_grad_())


@pytest.mark.parametrize(
    ("name", "told"),
    [
        (
            "best.pt",
            "a pickle may run a program and is never opened; `yolo export model=.*best.pt format=onnx end2end=False",
        ),
        ("best.pth", "never opened; .*export_onnx.py.*faster-rcnn=.*best.pth"),
        ("last.ckpt", "never opened"),
        ("best.engine", "another runtime .*yolo export model=best.pt"),
        ("best.tflite", "another runtime .*yolo export"),
        ("model.h5", "tf2onnx.convert --keras .*model.h5 --output .*model.onnx"),
    ],
)
def test_files_that_are_never_opened(name: str, told: str, tmp_path: Path) -> None:
    path = tmp_path / name
    with pytest.raises(RaucaError, match=f"{name}: not found"):
        load_detector(str(path))
    path.write_bytes(b"\x80\x02cos\nsystem\n")
    for typed in (str(path), f"yolox={path}", f"yolox-s={path}"):
        with pytest.raises(RaucaError, match=f"^{re.escape(str(path))}: .*{told}") as caught:
            load_detector(typed)
        assert "\n" not in str(caught.value)
