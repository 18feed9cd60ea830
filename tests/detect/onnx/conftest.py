"""Small graphs with the outputs of published exports, with seeded random weights."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


class EndToEnd(nn.Module):
    """(B, 20, 6): corners, score and number of the class of the best boxes, as YOLO26 puts them out."""

    def __init__(self) -> None:
        super().__init__()
        self.dense = V8()

    def forward(self, images: Tensor) -> Tensor:
        boxes, classes = self.dense(images).transpose(1, 2).split((4, CLASSES), 2)
        scores, labels = classes.max(2)
        index = scores.topk(20, 1).indices
        middle, half = boxes[..., :2], boxes[..., 2:] / 2
        found = torch.cat([middle - half, middle + half, scores[..., None], labels[..., None].float()], 2)
        return found.gather(1, index[..., None].expand(-1, -1, 6))


class Yolox(nn.Module):
    """(B, N, 5 + C), as YOLOX puts its cells out, or ``decoded``."""

    def __init__(self, decoded: bool = False) -> None:
        super().__init__()
        self.body, self.decoded = Backbone(5 + CLASSES), decoded

    def forward(self, images: Tensor) -> Tensor:
        found = []
        for x, stride in zip(self.body(images / 255), STRIDES, strict=True):
            center, size, scores = x.flatten(2).transpose(1, 2).split((2, 2, 1 + CLASSES), 2)
            if self.decoded:
                center, size = (center + cells(x).view(-1, 2)) * stride, size.exp() * stride
            found.append(torch.cat([center, size, scores.sigmoid()], 2))
        return torch.cat(found, 1)


class Queries(nn.Module):
    """12 queries of a whole image: logits (B, 12, columns) and boxes (B, 12, 4) as fractions, as DETR puts them out.

    ``joined``: one output (B, 12, 4 + columns) after the sigmoid, as Ultralytics' RT-DETR does.
    """

    def __init__(self, columns: int = CLASSES, joined: bool = False) -> None:
        super().__init__()
        self.columns, self.joined = columns, joined
        self.stem = nn.Sequential(nn.Conv2d(3, 12, 8, 8), nn.SiLU(), nn.AdaptiveAvgPool2d(2), nn.Flatten())
        self.head = nn.Linear(48, 12 * (4 + columns))

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor] | Tensor:
        found = self.head(self.stem(images)).view(-1, 12, 4 + self.columns)
        return found.sigmoid() if self.joined else (found[..., 4:], found[..., :4].sigmoid())


class Masked(nn.Module):
    """Boxes, logits with a column that nothing uses, and masks, as RF-DETR exports them."""

    def __init__(self) -> None:
        super().__init__()
        self.queries = Queries(CLASSES + 1)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        logits, boxes = self.queries(images)
        return boxes, logits, boxes[..., None, :2] * boxes[..., 2:, None]


class FinalQueries(nn.Module):
    """(B, 12, 6): boxes as fractions, score and number of the class, as Ultralytics' RT-DETR puts them out today."""

    def __init__(self) -> None:
        super().__init__()
        self.queries = Queries(joined=True)

    def forward(self, images: Tensor) -> Tensor:
        found = self.queries(images)
        scores, labels = found[..., 4:].max(2)
        return torch.cat([found[..., :4], scores[..., None], labels[..., None].float()], 2)


class Labelled(nn.Module):
    """Labels, boxes and scores, boxes scaled by a second input, as RT-DETR's own repository exports them."""

    def __init__(self) -> None:
        super().__init__()
        self.queries = Queries()

    def forward(self, images: Tensor, orig_target_sizes: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        logits, boxes = self.queries(images)
        scores, labels = logits.sigmoid().max(2)
        half = boxes[..., 2:] / 2
        corners = torch.cat([boxes[..., :2] - half, boxes[..., :2] + half], 2)
        return labels, corners * orig_target_sizes.repeat(1, 2)[:, None], scores


KINDS: dict[str, Callable[[], nn.Module]] = {
    "v5": V5,
    "v8": V8,
    "end2end": EndToEnd,
    "yolox": Yolox,
    "yolox-decoded": lambda: Yolox(decoded=True),
    "detr": lambda: Queries(CLASSES + 1),
    "rt-detr": Queries,
    "rt-detr-ultralytics": lambda: Queries(joined=True),
    "rt-detr-final": FinalQueries,
    "rt-detr-own": Labelled,
    "rf-detr": Masked,
}
OUTPUTS = {"detr": ["logits", "pred_boxes"], "rt-detr": ["logits", "pred_boxes"]}
OUTPUTS["rf-detr"] = ["dets", "labels", "masks"]
OUTPUTS["rt-detr-own"] = ["labels", "boxes", "scores"]


def export(
    kind: str,
    path: Path,
    size: int | tuple[int, int] = 64,
    metadata: bool = True,
    open_batch: bool = False,
    open_size: bool = False,
    batch: int = 1,
    opset: int = 17,
    names: bool = False,
) -> Path:
    """``metadata``: Ultralytics'. ``names``: a file of names beside."""
    network = KINDS[kind]()
    torch.manual_seed(0)
    for parameter in network.parameters():
        nn.init.normal_(parameter, std=0.3)
    height, width = (size, size) if isinstance(size, int) else size
    inputs = {"images": torch.rand(batch, 3, height, width)}
    if kind == "rt-detr-own":
        inputs["orig_target_sizes"] = torch.tensor([[width, height]] * batch)
    axes = {0: "batch"} if open_batch else {}
    axes |= {2: "height", 3: "width"} if open_size else {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network.eval(), tuple(inputs.values()), str(path), dynamo=False, opset_version=opset,
            input_names=list(inputs), output_names=OUTPUTS.get(kind, ["output0"]), dynamic_axes={"images": axes},
        )  # fmt: skip
    if metadata:
        model = onnx.load(path)
        onnx.helper.set_model_props(model, {"names": str(NAMES), "stride": "32", "imgsz": f"[{height}, {width}]"})
        onnx.save(model, path)
    if names:
        path.with_suffix(".names").write_text("\n".join(NAMES.values()))
    return path


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Path of the export of a kind of :data:`KINDS`; keywords go to :func:`export`."""
    made: dict[str, Path] = {}

    def make(kind: str, **options: Any) -> Path:
        key = f"{kind} {options}"
        if key not in made:
            made[key] = export(kind, tmp_path_factory.mktemp("onnx") / f"{kind}.onnx", **options)
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
