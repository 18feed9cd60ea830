"""Darknet, TensorFlow and caffe networks in OpenCV, which reads the same files on its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.detect import DarknetDetector, Source, load_detector
from rauca_core.detect.heads import Head
from rauca_core.detect.store import stored_paths

from .contender import Contender, Rows

REFERENCE = f"cv2.dnn {cv2.__version__}"
Blob = NDArray[np.float32]


@contextmanager
def darknet(source: Source) -> Iterator[Contender]:
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
    yield Contender(
        source.name,
        REFERENCE,
        detector.size,
        detector,
        prepare=lambda image: image.numpy(),
        run=_runner(published, outputs),
        rows=lambda found: _darknet_rows(found, [len(head.anchors) for head in heads]),
        run_openly=_runner(open_net, outputs),
    )


def _darknet_rows(outputs: list[Blob], anchors: list[int]) -> Rows:
    """OpenCV runs over cells, then anchors; we the other way round."""
    ordered = []
    for output, count in zip(outputs, anchors, strict=True):
        rows = output.reshape(-1, count, output.shape[-1]).swapaxes(0, 1).reshape(-1, output.shape[-1])
        half = rows[:, 2:4] / 2
        scores = np.where(rows[:, 5:] > 0, rows[:, 5:], np.nan)
        ordered.append(np.concatenate([rows[:, :2] - half, rows[:, :2] + half, scores], 1))
    return np.concatenate(ordered)


@contextmanager
def tensorflow(source: Source) -> Iterator[Contender]:
    """An SSD of TensorFlow, up to its heads: OpenCV's detections are few and rounded off by its thresholds."""
    graph, description = stored_paths(source)
    net = cv2.dnn.readNetFromTensorflow(str(graph), str(description))
    parts = ["BoxEncodingPredictor/concat", "ClassPredictor/concat/sigmoid", "PriorBox/concat"]
    # MobileNetV2's graph brings pixels of 0..255 to [-1, 1] itself, V3's has that cut off.
    scale, shift = (255.0, 0.0) if "v2" in source.name else (2.0, -1.0)
    yield _ssd(source, net, parts, lambda image: np.ascontiguousarray(image.numpy() * scale + shift))


@contextmanager
def caffe(source: Source) -> Iterator[Contender]:
    """A caffe SSD, up to its heads."""
    weights, prototxt = stored_paths(source)
    net = cv2.dnn.readNetFromCaffe(str(prototxt), str(weights))
    parts = ["mbox_loc", "mbox_conf_flatten", "mbox_priorbox"]

    def prepare(image: Tensor) -> Blob:
        return np.ascontiguousarray((image.numpy()[:, ::-1] * 255 - 127.5) * 0.007843)

    yield _ssd(source, net, parts, prepare)


def _ssd(source: Source, net: Any, parts: list[str], prepare: Callable[[Tensor], Blob]) -> Contender:
    detector: Any = load_detector(source.name)
    return Contender(
        source.name, REFERENCE, detector.size, detector, prepare, _runner(net, parts), lambda o: _ssd_rows(*o)
    )


def _ssd_rows(encodings: Blob, scores: Blob, priors: Blob) -> Rows:
    """Boxes from the encodings as OpenCV would decode them: offsets of center and log size, times the variances."""
    anchors, variances = priors.reshape(2, -1, 4)
    code = encodings.reshape(-1, 4) * variances
    center, size = (anchors[:, :2] + anchors[:, 2:]) / 2, anchors[:, 2:] - anchors[:, :2]
    middle, half = center + code[:, :2] * size, np.exp(code[:, 2:]) * size / 2
    return np.concatenate([middle - half, middle + half, scores.reshape(len(anchors), -1)[:, 1:]], 1)


def _runner(net: Any, parts: list[str]) -> Callable[[Blob], list[Blob]]:
    net.setPreferableBackend(cv2.dnn.DNN_BACKEND_OPENCV)

    def run(blob: Blob) -> list[Blob]:
        net.setInput(blob)
        return list(net.forward(parts))

    return run
