"""transformers' own networks as ONNX files: read by themselves, they are what the same network is in memory."""

from __future__ import annotations

import importlib.util
import warnings
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from rauca_core.detect import load_detector
from rauca_core.detect.frameworks.scaling import Scaling
from rauca_core.detect.frameworks.transformers_detector import TransformersDetector
from rauca_core.detect.onnx_detector import OnnxDetector
from tests.detect.gradients import checked_gradient
from tests.detect.test_frameworks_transformers import small_model

pytestmark = pytest.mark.skipif(
    not (importlib.util.find_spec("transformers") and importlib.util.find_spec("onnx2torch")),
    reason="the extra detectors is missing",
)
SIZE = 96


class Exported(nn.Module):
    """Logits and boxes, as Optimum exports them."""

    def __init__(self, model: Any) -> None:
        super().__init__()
        self.model = model

    def forward(self, pixel_values: Tensor) -> tuple[Tensor, Tensor]:
        found = self.model(pixel_values=pixel_values)
        return found.logits, found.pred_boxes


@pytest.mark.parametrize(
    ("kind", "opset", "open_batch"), [("detr", 20, True), ("rt_detr", 17, False), ("rt_detr", 20, True)]
)
def test_a_file_is_the_network_in_memory(kind: str, opset: int, open_batch: bool, tmp_path: Path) -> None:
    """Deformable attention, selected queries and encoders included: predictions agree."""
    model, path = small_model(kind), tmp_path / f"{kind}.onnx"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            Exported(model), (torch.rand(1, 3, SIZE, SIZE),), str(path), dynamo=False, opset_version=opset,
            input_names=["pixel_values"], output_names=["logits", "pred_boxes"],
            dynamic_axes={"pixel_values": {0: "batch"}} if open_batch else None,
        )  # fmt: skip
    path.with_suffix(".names").write_text("N/A\nCar\nmotorbike\n")
    square = Scaling(0, 0, SIZE, SIZE) if kind == "detr" else Scaling(0, 0, SIZE, SIZE, (0.0,) * 3, (1.0,) * 3)
    ours, theirs = load_detector(str(path)), TransformersDetector("theirs", model, scaling=square)
    assert isinstance(ours, OnnxDetector)
    assert ours.differentiable
    pixels = torch.rand(2, 3, 60, 80, generator=torch.Generator().manual_seed(1))
    mine, other = ours.dense(pixels.clone().requires_grad_()), theirs.dense(pixels)
    torch.testing.assert_close(mine.classes, other.classes, rtol=1e-3, atol=1e-4)
    torch.testing.assert_close(mine.boxes, other.boxes, rtol=1e-3, atol=1e-2)
    for mine, other in zip(ours.detect(pixels, 0.05), theirs.detect(pixels, 0.05), strict=True):
        torch.testing.assert_close(mine.scores, other.scores, rtol=1e-3, atol=1e-4)
        torch.testing.assert_close(mine.boxes, other.boxes, rtol=1e-3, atol=1e-2)
    # RT-DETR's own gradient stops at the places that it looks at, which no file says: the file's is the whole one.
    checked_gradient(ours, pixels[:1].clamp(0.01, 0.99), rtol=1e-3, atol=1e-5)
