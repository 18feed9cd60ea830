"""Adapters of ours, each beside the runtime that its network comes from, made comparable."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.detect import DarknetDetector, DensePredictions, Detections, Detector, Source, load_detector
from rauca_core.detect.darknet_network import Head
from rauca_core.detect.foreign import extra
from rauca_core.detect.frameworks.torchvision_detector import TorchvisionDetector
from rauca_core.detect.frameworks.torchvision_ops import import_torchvision
from rauca_core.detect.frameworks.transformers_detector import TransformersDetector
from rauca_core.detect.frameworks.transformers_loading import import_transformers
from rauca_core.detect.onnx_detector import OnnxDetector
from rauca_core.detect.weights import stored_paths

# A runtime that leaves a score out, as OpenCV does for boxes it suppressed, has NaN there: nothing to compare with.
Rows = NDArray[np.float32]
ROUNDING = 1e-5  # of scores; random weights give many detections nearly the same
OPENCV = f"cv2.dnn {cv2.__version__}"
NAMES = ("car", "boat", "bus")
SIZE = 320
THRESHOLDS = (0.2, 0.5)
RANDOM = "random weights"


@dataclass(frozen=True)
class Contender:
    """One adapter beside its reference, which takes what ``prepare`` makes of an image (1, 3, size, size).

    ``rows`` are what it found: (N, 4 + C) boxes as fractions of the image and scores per class, in our order; or, with
    ``thresholds`` of score and overlap, where it only shows what is left after suppression, (M, 6) boxes, score, label.
    ``run_openly`` runs where the difference is taken, for a reference that keeps low scores to itself.
    """

    name: str
    reference: str
    size: int
    detector: Detector
    prepare: Callable[[Tensor], Any]
    run: Callable[[Any], Any]
    rows: Callable[[Any], Rows]
    thresholds: tuple[float, float] | None = None
    run_openly: Callable[[Any], Any] | None = None

    def forward(self, image: Tensor) -> DensePredictions | list[Detections]:
        """Our part of the race: the same work, without gradients."""
        if self.thresholds:
            return self.detector.detect(image, *self.thresholds)
        with torch.inference_mode():
            return self.detector.dense(image)

    def backward(self, image: Tensor) -> None:
        """What an attack's step pays: predictions with gradients, and their way back to the image."""
        wanted = image.clone().requires_grad_()
        found = self.detector.dense(wanted)
        (found.objectness[..., None] * found.classes).amax((1, 2)).sum().backward()

    def differences(self, image: Tensor) -> float:
        """Largest difference of any score or box side (as a fraction of the image's)."""
        theirs = self.rows((self.run_openly or self.run)(self.prepare(image)))
        if self.thresholds:
            found = self.detector.detect(image, *self.thresholds)[0]
            ours = torch.cat([found.boxes / self.size, found.scores[:, None], found.labels[:, None]], 1).numpy()
            return unordered_difference(ours, theirs, self.thresholds[0])
        plain, with_gradient = (self.detector.dense(image.clone().requires_grad_(wants)) for wants in (False, True))
        return max(ordered_difference(dense_rows(found, self.size), theirs) for found in (plain, with_gradient))


def dense_rows(found: DensePredictions, size: int) -> Rows:
    """(N, 4 + C): boxes as fractions of the image, scores."""
    scores = found.objectness[0, :, None] * found.classes[0]
    return torch.cat([found.boxes[0] / size, scores], 1).detach().numpy()


def ordered_difference(ours: Rows, theirs: Rows) -> float:
    """NaN counts as nothing said; shapes must be the same, or all is different."""
    if ours.shape != theirs.shape or np.isnan(theirs).all():
        return float("inf")
    return float(np.nanmax(np.abs(ours - theirs)))


def unordered_difference(ours: Rows, theirs: Rows, threshold: float = 0.0) -> float:
    """Each detection against the nearest of the same label, both ways: equal scores may come in any order.

    One whose score is the ``threshold`` but for rounding may be missing on either side.
    """
    sure, theirs_sure = (rows[:, 4] > threshold + ROUNDING for rows in (ours, theirs))
    if not 0 < sure.sum() <= len(theirs) or not 0 < theirs_sure.sum() <= len(ours):
        return float("inf")
    apart = np.abs(ours[:, None, :5] - theirs[None, :, :5]).max(2)
    apart[ours[:, None, 5] != theirs[None, :, 5]] = np.inf
    return float(max(apart.min(0)[theirs_sure].max(), apart.min(1)[sure].max()))


def darknet(source: Source) -> Contender:
    """A darknet network; for the difference OpenCV's threshold is lowered, as it puts zeros below."""
    detector = load_detector(source.name)
    assert isinstance(detector, DarknetDetector)
    weights = stored_paths(source)[0]
    heads = [layer for layer in detector.network.layers if isinstance(layer, Head)]
    with TemporaryDirectory(prefix="rauca-bench-") as folder:
        lowered = Path(folder) / source.cfg.name
        text = source.cfg.read_text()
        for kind in ("yolo", "region"):
            text = text.replace(f"[{kind}]", f"[{kind}]\nthresh=1e-12")
        lowered.write_text(text)
        published, open_net = (cv2.dnn.readNetFromDarknet(str(cfg), str(weights)) for cfg in (source.cfg, lowered))
    outputs = list(published.getUnconnectedOutLayersNames())
    return Contender(
        source.name,
        OPENCV,
        detector.size,
        detector,
        prepare=lambda image: image.numpy(),
        run=_runner(published, outputs),
        rows=lambda found: _darknet_rows(found, [len(head.anchors) for head in heads]),
        run_openly=_runner(open_net, outputs),
    )


def _darknet_rows(outputs: list[Rows], anchors: list[int]) -> Rows:
    """OpenCV runs over cells, then anchors; we the other way round."""
    ordered = []
    for output, count in zip(outputs, anchors, strict=True):
        rows = output.reshape(-1, count, output.shape[-1]).swapaxes(0, 1).reshape(-1, output.shape[-1])
        half = rows[:, 2:4] / 2
        scores = np.where(rows[:, 5:] > 0, rows[:, 5:], np.nan)
        ordered.append(np.concatenate([rows[:, :2] - half, rows[:, :2] + half, scores], 1))
    return np.concatenate(ordered)


def tensorflow(source: Source) -> Contender:
    """An SSD of TensorFlow, up to its heads: OpenCV's detections are few and rounded off by its thresholds."""
    graph, description = stored_paths(source)
    net = cv2.dnn.readNetFromTensorflow(str(graph), str(description))
    parts = ["BoxEncodingPredictor/concat", "ClassPredictor/concat/sigmoid", "PriorBox/concat"]
    # MobileNetV2's graph brings pixels of 0..255 to [-1, 1] itself, V3's has that cut off.
    scale, shift = (255.0, 0.0) if "v2" in source.name else (2.0, -1.0)
    return _ssd(source, net, parts, lambda image: np.ascontiguousarray(image.numpy() * scale + shift))


def caffe(source: Source) -> Contender:
    """A caffe SSD, up to its heads."""
    weights, prototxt = stored_paths(source)
    net = cv2.dnn.readNetFromCaffe(str(prototxt), str(weights))
    parts = ["mbox_loc", "mbox_conf_flatten", "mbox_priorbox"]
    return _ssd(
        source, net, parts, lambda image: np.ascontiguousarray((image.numpy()[:, ::-1] * 255 - 127.5) * 0.007843)
    )


def _ssd(source: Source, net: Any, parts: list[str], prepare: Callable[[Tensor], Rows]) -> Contender:
    detector: Any = load_detector(source.name)
    run = _runner(net, parts)
    return Contender(source.name, OPENCV, detector.size, detector, prepare, run, lambda found: _ssd_rows(*found))


def _ssd_rows(encodings: Rows, scores: Rows, priors: Rows) -> Rows:
    """Boxes as OpenCV decodes them: offsets of center and log size, times the variances."""
    anchors, variances = priors.reshape(2, -1, 4)
    code = encodings.reshape(-1, 4) * variances
    center, size = (anchors[:, :2] + anchors[:, 2:]) / 2, anchors[:, 2:] - anchors[:, :2]
    middle, half = center + code[:, :2] * size, np.exp(code[:, 2:]) * size / 2
    return np.concatenate([middle - half, middle + half, scores.reshape(len(anchors), -1)[:, 1:]], 1)


def _runner(net: Any, parts: list[str]) -> Callable[[Rows], list[Rows]]:
    net.setPreferableBackend(cv2.dnn.DNN_BACKEND_OPENCV)

    def run(blob: Rows) -> list[Rows]:
        net.setInput(blob)
        return list(net.forward(parts))

    return run


def yolox(source: Source) -> Contender:
    """A YOLOX export; its decoding is written out in NumPy."""
    onnxruntime = extra("onnxruntime")
    path = stored_paths(source)[0]
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    detector = load_detector(source.name)
    assert isinstance(detector, OnnxDetector)
    return Contender(
        source.name,
        f"onnxruntime {onnxruntime.__version__}",
        detector.size,
        detector,
        prepare=lambda image: np.ascontiguousarray(image.numpy()[:, ::-1] * np.float32(255)),
        run=lambda blob: session.run(None, {session.get_inputs()[0].name: blob}),
        rows=lambda outputs: _decoded(outputs[0][0], detector.size),
    )


def _decoded(output: NDArray[np.float32], size: int) -> Rows:
    places = [np.indices((size // s, size // s))[::-1].reshape(2, -1).T for s in (8, 16, 32)]
    strides = np.concatenate([np.full((len(p), 1), s) for p, s in zip(places, (8, 16, 32), strict=True)])
    center = (output[:, :2] + np.concatenate(places)) * strides / size
    half = np.exp(output[:, 2:4]) * strides / size / 2
    return np.concatenate([center - half, center + half, output[:, 4:5] * output[:, 5:]], 1).astype(np.float32)


OF_FAMILY = {"darknet": darknet, "tf-ssd": tensorflow, "caffe-ssd": caffe, "onnx": yolox}


def torchvision(architecture: str) -> Contender:
    """Faster R-CNN or SSDlite: softmax over few categories, so random weights make detections too."""
    package = import_torchvision()
    torch.manual_seed(0)
    model = getattr(package.models.detection, architecture)(
        weights=None, weights_backbone=None, num_classes=len(NAMES) + 1
    )
    if "ssd" not in architecture:
        model.transform.min_size, model.transform.max_size = (SIZE,), SIZE
    detector = TorchvisionDetector(architecture, model, NAMES)
    reference: Any = copy.deepcopy(detector.network)
    limits = getattr(reference, "roi_heads", reference)
    limits.score_thresh, limits.nms_thresh = THRESHOLDS
    return Contender(
        f"{architecture} ({RANDOM})",
        f"torchvision {package.__version__}",
        SIZE,
        detector,
        prepare=list,
        run=torch.inference_mode()(reference),
        rows=lambda found: _rows(found, first_label=1),  # 0 is the background
        thresholds=THRESHOLDS,
    )


def transformers(prefix: str) -> Contender:
    """DETR, Deformable DETR or RT-DETR of its usual size."""
    package = import_transformers()
    torch.manual_seed(0)
    labels: dict[str, Any] = {"id2label": dict(enumerate(NAMES))}
    if prefix != "RTDetr":
        labels |= {"backbone_config": package.ResNetConfig(out_features=["stage4"]), "use_timm_backbone": False}
    if prefix == "DeformableDetr":
        labels["backbone_config"] = package.ResNetConfig(out_features=["stage2", "stage3", "stage4"])
    model = getattr(package, f"{prefix}ForObjectDetection")(getattr(package, f"{prefix}Config")(**labels)).eval()
    size = {"height": SIZE, "width": SIZE} if prefix == "RTDetr" else {"shortest_edge": SIZE, "longest_edge": SIZE}
    processor = getattr(package, f"{prefix}ImageProcessor")(size=size)
    detector = TransformersDetector(prefix, copy.deepcopy(model), size=SIZE)
    with torch.no_grad():
        # Nearly every query is a detection, whatever random weights make of the scores of other pictures.
        threshold = float(detector.dense(torch.full((1, 3, SIZE, SIZE), 0.5)).classes.amax(2).median() / 2)

    @torch.inference_mode()
    def run(images: list[Tensor]) -> Any:
        prepared = processor(images=images, do_rescale=False, return_tensors="pt")
        outputs = model(**prepared)
        sizes = [(SIZE, SIZE)] * len(images)
        return processor.post_process_object_detection(outputs, threshold=threshold, target_sizes=sizes)

    return Contender(
        f"{prefix} ({RANDOM})",
        f"transformers {package.__version__}",
        SIZE,
        detector,
        prepare=list,
        run=run,
        rows=lambda found: _rows(found, first_label=0),
        thresholds=(threshold, 1.0),
    )


def _rows(found: list[dict[str, Tensor]], first_label: int) -> Rows:
    (one,) = found
    boxes, labels = one["boxes"].clamp(0, SIZE) / SIZE, one["labels"] - first_label
    return torch.cat([boxes, one["scores"][:, None], labels[:, None]], 1).numpy()
