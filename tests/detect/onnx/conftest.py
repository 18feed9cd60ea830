"""Small graphs with the outputs of Ultralytics' exports, with seeded random weights."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

onnx = pytest.importorskip("onnx")

CLASSES = 3
STRIDES = (8, 16, 32)
NAMES = {0: "boat", 1: "Car", 2: "aeroplane"}


class Backbone(nn.Module):
    """Feature maps (B, outputs, h, w) at the three strides."""

    def __init__(self, outputs: int) -> None:
        super().__init__()
        self.stem = nn.Sequential(nn.Conv2d(3, 12, 8, 8), nn.SiLU())
        self.deeper = nn.ModuleList([nn.Sequential(nn.Conv2d(12, 12, 2, 2), nn.SiLU()) for _ in range(2)])
        self.heads = nn.ModuleList([nn.Conv2d(12, outputs, 1) for _ in STRIDES])

    def forward(self, images: Tensor) -> list[Tensor]:
        x = self.stem(images)
        maps = [self.heads[0](x)]
        for deeper, head in zip(self.deeper, self.heads[1:], strict=True):
            x = deeper(x)
            maps.append(head(x))
        return maps


def cells(x: Tensor) -> Tensor:
    """Column and row of each cell of a map, (h, w, 2)."""
    rows, columns = torch.meshgrid(torch.arange(x.shape[2]), torch.arange(x.shape[3]), indexing="ij")
    return torch.stack([columns, rows], -1).float()


class V5(nn.Module):
    """(B, 3 N, 5 + C): decoded boxes, objectness and classes, as a YOLOv5 export puts them out."""

    def __init__(self) -> None:
        super().__init__()
        self.body = Backbone(3 * (5 + CLASSES))

    def forward(self, images: Tensor) -> Tensor:
        found = []
        for x, stride in zip(self.body(images), STRIDES, strict=True):
            batch, _, height, width = x.shape
            y = x.view(batch, 3, 5 + CLASSES, height, width).permute(0, 1, 3, 4, 2).sigmoid()
            xy = (y[..., 0:2] * 2 - 0.5 + cells(x)) * stride
            wh = (y[..., 2:4] * 2) ** 2 * (1.5 * stride)
            found.append(torch.cat([xy, wh, y[..., 4:]], -1).reshape(batch, -1, 5 + CLASSES))
        return torch.cat(found, 1)


class V8(nn.Module):
    """(B, 4 + C, N): boxes from distributions over 16 distances per side, no objectness, as v8 and v11 put them out."""

    def __init__(self) -> None:
        super().__init__()
        self.body = Backbone(64 + CLASSES)

    def forward(self, images: Tensor) -> Tensor:
        found = []
        for x, stride in zip(self.body(images), STRIDES, strict=True):
            distribution, classes = x.flatten(2).split((64, CLASSES), 1)
            sides = distribution.view(x.shape[0], 4, 16, -1).softmax(2)
            distances = (sides * torch.arange(16.0).view(1, 1, 16, 1)).sum(2)
            centers = (cells(x) + 0.5).view(-1, 2).T[None]
            low, high = centers - distances[:, :2], centers + distances[:, 2:]
            found.append(torch.cat([(low + high) / 2 * stride, (high - low) * stride, classes.sigmoid()], 1))
        return torch.cat(found, 2)


def export(network: nn.Module, path: Path, size: int = 64, metadata: bool = True, open_batch: bool = False) -> Path:
    torch.manual_seed(0)
    for parameter in network.parameters():
        nn.init.normal_(parameter, std=0.3)
    axes = {"images": {0: "batch"}, "output0": {0: "batch"}} if open_batch else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network.eval(), (torch.rand(1, 3, size, size),), str(path), dynamo=False, opset_version=17,
            input_names=["images"], output_names=["output0"], dynamic_axes=axes,
        )  # fmt: skip
    if metadata:
        model = onnx.load(path)
        onnx.helper.set_model_props(model, {"names": str(NAMES), "stride": "32", "imgsz": f"[{size}, {size}]"})
        onnx.save(model, path)
    return path


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Path of the export ``"v5"`` or ``"v8"``; keywords go to :func:`export`."""
    made: dict[str, Path] = {}

    def make(kind: str, **options: bool | int) -> Path:
        key = f"{kind} {options}"
        if key not in made:
            folder = tmp_path_factory.mktemp("onnx")
            made[key] = export(V5() if kind == "v5" else V8(), folder / f"{kind}.onnx", **options)
        return made[key]

    return make


@pytest.fixture(scope="session")
def yolox_nano() -> Path:
    """The published YOLOX-nano, where the shared folder or the cache has it."""
    from rauca_core.detect import SOURCES
    from rauca_core.detect.weights import stored_paths

    shared = Path(os.environ.get("RAUCA_SHARED") or Path(__file__).parents[4] / "shared")
    for path in (*stored_paths(SOURCES["yolox-nano"]), shared / "detectors" / "yolox_nano.onnx"):
        if path.is_file():
            return path
    pytest.skip("yolox-nano is neither in the cache nor in the shared folder")
