"""What ONNX graphs take and give: YOLOX's and Ultralytics' exports, DETR's family, and graphs that suppress themselves.

A graph does not say what its outputs mean. Their shapes and names do, and where two kinds share a shape, the values
that the graph gives for a picture of noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor

from ..contract import RaucaError
from .darknet_network import MAX_LOG_SIZE
from .exports import DETR_EXPORT, RTDETR_EXPORT, YOLOX_EXPORT, yolo_export
from .frameworks.scaling import Scaling
from .interface import DensePredictions
from .letterbox import Letterbox
from .nms import corners
from .onnx_graph import OnnxGraph

STRIDES = ((8, 16, 32), (8, 16, 32, 64))
GREY = 114 / 255
TASKS = ("", "detect", "segment")  # Ultralytics'; nothing in files of others
GraphFamily = Literal["yolox", "ultralytics"]
Outputs = tuple[Tensor, ...]
Shape = tuple[int, int]


@dataclass(frozen=True)
class Layout:
    """How to feed a graph and read it.

    Attributes:
        kind: what was recognized, for people.
        classes: how many categories it tells apart.
        decode: the graph's outputs to predictions, boxes in pixels of its input; with ``scaling`` as fractions of it.
        yolox: wants BGR in 0..255 in the top left corner, rather than RGB in 0..1 in the middle.
        stretched: wants images scaled unevenly.
        scaling: of DETR's family: resizing and normalization.
        queries: says each object once, without suppression.
        exclusive: of these: a query has one class.
        final: not empty where its predictions are what is left after a choice of its own, so that an attack has nothing
            to differentiate: the command that exports all of them.
    """

    kind: str
    classes: int
    decode: Callable[[Outputs], DensePredictions]
    yolox: bool = False
    stretched: bool = False
    scaling: Scaling | None = None
    queries: bool = False
    exclusive: bool = False
    final: str = ""

    @property
    def settings(self) -> str:
        """What a prediction depends on beside the graph."""
        more = f" {self.kind} {self.scaling}" if self.queries else ""
        return f"{self.yolox}{more}"

    def predict(self, name: str, images: Tensor, size: Shape, run: Callable[[Tensor], Outputs]) -> DensePredictions:
        """Predictions in sRGB images (B, 3, H, W) of the graph ``run``, whose input is of ``size``; boxes in pixels."""
        if self.scaling is not None:
            found = self.decode(run(self.scaling.fit(name, images)))
            found.boxes = found.boxes * found.boxes.new_tensor([images.shape[3], images.shape[2]] * 2)
            return found
        box = Letterbox(images.shape[2], images.shape[3], size, not self.yolox, GREY, self.stretched)
        return box.predict(images, lambda fitted: self.decode(run(fitted.flip(1) * 255.0 if self.yolox else fitted)))


def find_layout(
    graph: OnnxGraph, outputs: Outputs, size: Shape, family: GraphFamily | None, names: int
) -> Layout | None:
    """The layout of a graph without DETR's two outputs; None for those.

    Args:
        outputs: what it gives for an image of noise of ``size``.
        family: when it is known; YOLOX otherwise if the rows are its cells.
        names: how many class names are known, 0 for none.

    Raises:
        RaucaError: it is none of ours.
    """
    if graph.task not in TASKS:
        raise RaucaError(f"{graph.path}: exported for the task {graph.task!r}; boxes are wanted, of a detection model")
    found = _of_sizes(graph, names) if graph.sizes_name else None
    if found is None and outputs[0].ndim == 3:
        found = _of_cells(graph, outputs[0], size, family, names)
        if found is None and (len(outputs) == 1 or graph.task) and family != "yolox":
            found = _final(graph.path, outputs[0], size, names) or _of_detr(outputs[0], size)
    if found is None and (sum(one.ndim == 3 for one in outputs) != 2 or family == "yolox"):
        raise RaucaError(_unknown(graph, outputs, size, family))
    if found is not None and found.final and not names:
        raise RaucaError(
            f"{graph.path}: class names are not in it; write {graph.path.with_suffix('.names')}, one a line"
        )
    return found


def _unknown(graph: OnnxGraph, outputs: Outputs, size: Shape, family: GraphFamily | None) -> str:
    shapes = ", ".join(f"{name} {tuple(one.shape)}" for name, one in zip(graph.output_names, outputs, strict=True))
    if family == "yolox":
        return f"{graph.path}: gives {shapes}, not YOLOX's (1, N, 5 + C); export it anew: `{YOLOX_EXPORT}`"
    return (
        f"{graph.path}: gives {shapes} for {size[1]} x {size[0]} pixels, no known output of YOLO, YOLOX or DETR; "
        f"export it anew, Ultralytics: {yolo_export('best.pt')}, YOLOX: `{YOLOX_EXPORT}`, DETR: `{DETR_EXPORT}`"
    )


def _of_cells(graph: OnnxGraph, output: Tensor, size: Shape, family: GraphFamily | None, names: int) -> Layout | None:
    """YOLO's: a row or a column for every cell of its grids, or three."""
    _, rows, columns = output.shape
    for strides in STRIDES:
        cells = sum((size[0] // stride) * (size[1] // stride) for stride in strides)
        if columns == cells and rows > 4 and family != "yolox":
            classes = names if graph.task == "segment" and names else rows - 4
            return Layout("YOLOv8, 11, 12 or 26", classes, partial(decode_v8, classes=classes))
        if rows == 3 * cells and columns > 5 and family != "yolox":
            return Layout("YOLOv5 or v7", columns - 5, decode_v5)
        if rows == cells and columns > 5 and family != "ultralytics":
            return _of_one_box_per_cell(output, size, strides, family)
    return None


def _of_one_box_per_cell(output: Tensor, size: Shape, strides: tuple[int, ...], family: GraphFamily | None) -> Layout:
    """YOLOX, as its cells give boxes or decoded; or YOLOv6, whose objectness is 1 throughout."""
    classes = output.shape[2] - 5
    places, scales = _grid(size, strides, output)
    decoded = (output[..., :2] / scales - places).abs().mean() < output[..., :2].abs().mean()
    if decoded and family is None and bool((output[..., 4] == 1).all()):
        return Layout("YOLOv6", classes, decode_v5)
    if decoded:
        return Layout("YOLOX, decoded", classes, decode_v5, yolox=True)
    return Layout("YOLOX", classes, partial(decode_yolox, size=size, strides=strides), yolox=True)


def _final(path: Path, output: Tensor, size: Shape, names: int) -> Layout | None:
    """Ultralytics' end-to-end exports: (B, M, 6 or more) of a box, score and a class's number.

    YOLO's boxes are corners in pixels, RT-DETR's center and size as fractions of the stretched image.
    """
    if output.shape[2] < 6 or not bool((output[..., 5] == output[..., 5].round()).all()):
        return None
    boxes = output[..., :4]
    if boxes.numel() and bool((boxes >= 0).all() and 0 < boxes.max() <= 1):
        decode = partial(decode_final, classes=names, fractions_of=size)
        return Layout(
            "RT-DETR of Ultralytics, end to end",
            names,
            decode,
            stretched=True,
            queries=True,
            exclusive=True,
            final=f"`{RTDETR_EXPORT}`",
        )
    decode = partial(decode_final, classes=names)
    return Layout("YOLO, end to end", names, decode, queries=True, exclusive=True, final=yolo_export(path))


def _of_detr(output: Tensor, size: Shape) -> Layout | None:
    """Ultralytics' RT-DETR: (B, Q, 4 + C), boxes as fractions of the stretched image, scores after the sigmoid."""
    if output.shape[2] < 5 or not bool(((output >= 0) & (output <= 1)).all()):
        return None
    decode = partial(decode_rtdetr, size=size)
    return Layout("RT-DETR of Ultralytics", output.shape[2] - 4, decode, stretched=True, queries=True)


def _of_sizes(graph: OnnxGraph, names: int) -> Layout | None:
    """RT-DETR's and D-FINE's own exports: labels, boxes and scores, boxes scaled by the second input."""
    if set(graph.output_names) != {"labels", "boxes", "scores"}:
        return None
    order = [graph.output_names.index(name) for name in ("labels", "boxes", "scores")]
    decode = partial(decode_labels, order=order, classes=names)
    return Layout(
        "DETR, end to end", names, decode, stretched=True, queries=True, exclusive=True, final=f"`{DETR_EXPORT}`"
    )


def decode_yolox(outputs: Outputs, size: Shape, strides: tuple[int, ...]) -> DensePredictions:
    """(B, cells, 5 + C): center relative to its cell in cells, log of the size in cells, objectness, classes."""
    output = outputs[0]
    places, scales = _grid(size, strides, output)
    center = (output[..., :2] + places) * scales
    half = 0.5 * output[..., 2:4].clamp(max=MAX_LOG_SIZE).exp() * scales
    return DensePredictions(torch.cat([center - half, center + half], -1), output[..., 4], output[..., 5:])


def decode_v5(outputs: Outputs) -> DensePredictions:
    """(B, N, 5 + C): center and size in pixels, objectness, classes."""
    output = outputs[0]
    return DensePredictions(corners(output[..., :4]), output[..., 4], output[..., 5:])


def decode_v8(outputs: Outputs, classes: int) -> DensePredictions:
    """(B, 4 + C, N): center and size in pixels, classes; no objectness. Coefficients of masks may follow."""
    output = outputs[0].transpose(1, 2)
    return DensePredictions(corners(output[..., :4]), torch.ones_like(output[..., 0]), output[..., 4 : 4 + classes])


def decode_rtdetr(outputs: Outputs, size: Shape) -> DensePredictions:
    """(B, Q, 4 + C): center and size as fractions of the input, classes."""
    output = outputs[0]
    boxes = corners(output[..., :4]) * output.new_tensor([size[1], size[0]] * 2)
    return DensePredictions(boxes, torch.ones_like(output[..., 0]), output[..., 4:])


def decode_final(outputs: Outputs, classes: int, fractions_of: Shape | None = None) -> DensePredictions:
    """(B, M, 6 or more): corners in pixels, or center and size as fractions of an input; score, number of the class."""
    output = outputs[0]
    boxes = output[..., :4]
    if fractions_of is not None:
        boxes = corners(boxes) * boxes.new_tensor([fractions_of[1], fractions_of[0]] * 2)
    return DensePredictions(boxes, output[..., 4], _only(output[..., 5], classes))


def decode_labels(outputs: Outputs, order: list[int], classes: int) -> DensePredictions:
    """Numbers of classes (B, M), corners in pixels (B, M, 4) and scores (B, M)."""
    labels, boxes, scores = (outputs[index] for index in order)
    return DensePredictions(boxes, scores, _only(labels, classes))


def _only(labels: Tensor, classes: int) -> Tensor:
    """Numbers of classes (...) as probabilities of 0 and 1, (..., C); all 0 for a number beyond them."""
    return (labels[..., None].round() == torch.arange(classes, device=labels.device)).float()


def _grid(size: Shape, strides: tuple[int, ...], like: Tensor) -> tuple[Tensor, Tensor]:
    """Column and row of every cell (cells, 2), and its side in pixels (cells, 1); row by row, fine strides first."""
    places, scales = [], []
    for stride in strides:
        steps = [torch.arange(side // stride, dtype=like.dtype, device=like.device) for side in size]
        rows, columns = torch.meshgrid(*steps, indexing="ij")
        places.append(torch.stack([columns, rows], -1).view(-1, 2))
        scales.append(torch.full_like(places[-1][:, :1], stride))
    return torch.cat(places), torch.cat(scales)
