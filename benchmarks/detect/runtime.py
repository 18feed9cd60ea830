"""ONNX networks in onnxruntime."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from rauca_core.detect import Source
from rauca_core.detect.onnx_detector import OnnxDetector
from rauca_core.detect.onnx_graph import extra
from rauca_core.detect.store import stored_paths

from .contender import Contender, Rows


@contextmanager
def yolox(source: Source) -> Iterator[Contender]:
    """A YOLOX export; its decoding is written out in NumPy."""
    onnxruntime = extra("onnxruntime")
    path = stored_paths(source)[0]
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
    detector = OnnxDetector(source.name, path, source.class_names, family="yolox")
    yield Contender(
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
