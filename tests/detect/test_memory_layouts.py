"""The same pixels in another memory layout are the same image: to ``dense``, its gradient and ``detect``.

Optimizers make frames as rows of pixels and hand a permuted view on; others come sliced, or repeated without a copy.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor

from rauca_core.detect import Detector, load_detector
from rauca_core.detect.frameworks.torchvision_ops import import_torchvision
from tests.detect.conftest import EVERY_LAYER, write_random_weights
from tests.detect.graphs import conftest as tensorflow
from tests.detect.graphs import test_graphs_caffe as caffe

frameworks = pytest.mark.skipif(not importlib.util.find_spec("onnx2torch"), reason="the extra detectors is missing")
NAMES = ("boat", "Car", "aeroplane")


def darknet(folder: Path) -> Detector:
    cfg = folder / "every.cfg"
    cfg.write_text(EVERY_LAYER)
    return load_detector(str(write_random_weights(folder / "every.weights", cfg)), 64, names=NAMES[:2])


def tf_ssd(folder: Path) -> Detector:
    return load_detector(str(tensorflow.ssd_graph(lite=False).save(folder / "every.pb")), 33, names=(*NAMES, "bus"))


def caffe_ssd(folder: Path) -> Detector:
    (folder / "every.prototxt").write_text(caffe.EVERY_LAYER)
    return load_detector(str(caffe.save(folder / "every.caffemodel", caffe.random_weights())), names=caffe.NAMES)


def onnx(kind: str, **options: bool) -> Callable[[Path], Detector]:
    def make(folder: Path) -> Detector:
        from tests.detect.onnx.conftest import export

        return load_detector(str(export(kind, folder / f"{kind}.onnx", **options)))  # type: ignore[arg-type]

    return make


def torchvision(folder: Path) -> Detector:
    torch.manual_seed(0)
    options = {"weights": None, "weights_backbone": None, "num_classes": 4}
    model = import_torchvision().models.detection.ssdlite320_mobilenet_v3_large(**options)
    return load_detector(model, names=NAMES)


def transformers(folder: Path) -> Detector:
    from tests.detect.test_frameworks_transformers import small_model

    return load_detector(small_model("rt_detr"), 96)


def module(folder: Path) -> Detector:
    from tests.detect.test_modules import small_network

    return load_detector(small_network(), names=NAMES)


FAMILIES: dict[str, Callable[[Path], Detector]] = {
    "darknet": darknet,
    "tf-ssd": tf_ssd,
    "caffe-ssd": caffe_ssd,
    "onnx-v5": onnx("v5"),
    "onnx-v8": onnx("v8"),
    "onnx-end2end": onnx("end2end"),
    "onnx-yolox": onnx("yolox", metadata=False, names=True),
    "onnx-detr": onnx("detr", metadata=False, names=True),
    "torchvision": torchvision,
    "transformers": transformers,
    "module": module,
    "synth-two-stage": lambda folder: load_detector("frcnn-synth"),
    "synth-transformer": lambda folder: load_detector("detr-synth"),
}
NEEDS_EXTRA = ("onnx", "torchvision", "transformers", "synth")

# From pixels (2, 3, 48, 80) to a batch: of these pixels, some of them, or one image twice.
LAYOUTS: dict[str, Callable[[Tensor], Tensor]] = {
    "channels_last": lambda x: x.contiguous(memory_format=torch.channels_last),
    "permuted": lambda x: x.permute(0, 2, 3, 1).reshape(-1, 3).clone().reshape(2, 48, 80, 3).permute(0, 3, 1, 2),
    "expanded": lambda x: x[:1].expand(2, -1, -1, -1),
    "one grey": lambda x: x.mean(1, keepdim=True).expand(-1, 3, -1, -1),
    "sliced": lambda x: x[:, :, 3:-4, ::2],
    "flipped": lambda x: x.flip(1)[:, [2, 1, 0]].transpose(2, 3),
}


@pytest.fixture(
    scope="module", params=[pytest.param(n, marks=frameworks if n.startswith(NEEDS_EXTRA) else ()) for n in FAMILIES]
)
def detector(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Detector:
    return FAMILIES[request.param](tmp_path_factory.mktemp("layouts"))


def gradient(detector: Detector, pixels: Tensor, layout: Callable[[Tensor], Tensor]) -> Tensor:
    pixels = pixels.clone().requires_grad_()
    found = detector.dense(layout(pixels))
    scores = found.objectness[..., None] * found.classes
    (made,) = torch.autograd.grad(scores.square().sum() + 1e-3 * found.boxes.sin().sum(), pixels)
    return made


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_layout_changes_nothing(name: str, detector: Detector) -> None:
    pixels = torch.rand(2, 3, 48, 80, generator=torch.Generator().manual_seed(2))
    layout = LAYOUTS[name]
    images = layout(pixels)
    copy = images.clone(memory_format=torch.contiguous_format)
    assert images.stride() != copy.stride()
    for ours, theirs in zip(detector.detect(images, 0.003), detector.detect(copy, 0.003), strict=True):
        assert len(theirs.scores) > 0
        torch.testing.assert_close(ours.scores, theirs.scores, atol=1e-5, rtol=1e-4)
        torch.testing.assert_close(ours.boxes, theirs.boxes, atol=1e-2, rtol=1e-4)
        assert torch.equal(ours.labels, theirs.labels)
    if not getattr(detector, "differentiable", True):  # a graph that suppresses for itself
        return
    expected = gradient(detector, pixels, lambda x: layout(x).clone(memory_format=torch.contiguous_format))
    assert expected.abs().max() > 0
    found = gradient(detector, pixels, layout)
    torch.testing.assert_close(found, expected, atol=1e-4 * float(expected.abs().max()), rtol=1e-3)
