"""ONNX exports of DETR's family with two outputs: boxes (B, Q, 4) as fractions of the image, logits (B, Q, K).

Neither says whether the logits are for a softmax with a last column for "no object" (DETR) or one sigmoid per class
(Deformable DETR, RT-DETR, D-FINE, RF-DETR), nor how images are normalized. Optimum writes both beside the file, in
``config.json`` and ``preprocessor_config.json``; without them the number of class names decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from ..contract import RaucaError
from .classes import GAP, canonical, class_list
from .frameworks.scaling import AS_THEY_ARE, Scaling, read_json, read_scaling
from .interface import DensePredictions
from .nms import corners
from .onnx_graph import OnnxGraph
from .onnx_layouts import Layout, Outputs, Shape

SOFTMAX = ("detr", "table-transformer", "yolos")  # model types of transformers
RF_DETR = {"dets", "labels"}  # names of its exports' outputs: sigmoids, a last column that nothing uses


def detr_layout(
    graph: OnnxGraph, outputs: Outputs, size: Shape, names: Sequence[str] | None
) -> tuple[Layout, tuple[str, ...]]:
    """The layout of a graph with two outputs, and its class names.

    Args:
        outputs: what it gives for an image of ``size``.
        names: None where neither the user nor the file says them.

    Raises:
        RaucaError: other outputs; names that are unknown or of another number than the logits' columns.
    """
    boxes, logits = _order(graph, outputs)
    columns = outputs[logits].shape[2]
    kind = _config(graph)
    found = tuple(names or _named(kind) or _usual(columns))
    if len(found) not in (columns, columns - 1):
        raise RaucaError(
            f"{graph.path}: predicts {columns} columns of classes, {len(found) or 'no'} names are known; write "
            f"{graph.path.with_suffix('.names')}, one a line: {columns} if each has its sigmoid, {columns - 1} if the "
            "last column is the background"
        )
    rf_detr = set(graph.output_names) >= RF_DETR
    softmax = len(found) < columns and not rf_detr
    if "model_type" in kind:
        softmax = kind["model_type"] in SOFTMAX
    decode = partial(_decode, boxes=boxes, logits=logits, classes=len(found), softmax=softmax)
    scaling = _scaling(graph, size, imagenet=softmax or rf_detr)
    says = "softmax with a last background" if softmax else "a sigmoid per class"
    return Layout(f"DETR, {says}", len(found), decode, scaling=scaling, queries=True, exclusive=softmax), found


def _order(graph: OnnxGraph, outputs: Outputs) -> tuple[int, int]:
    """Indices of boxes and logits."""
    names = {index: graph.output_names[index] for index, one in enumerate(outputs) if one.ndim == 3}  # masks have 4
    shapes = {index: tuple(outputs[index].shape) for index in names}
    fits = [index for index in names if shapes[index][2] == 4]
    if len(fits) == 2:  # four columns of classes
        fits = [index for index in fits if any(part in names[index].lower() for part in ("box", "dets"))]
    if len(fits) != 1 or len({shape[:2] for shape in shapes.values()}) != 1:
        told = ", ".join(f"{names[index]} {shapes[index]}" for index in names)
        raise RaucaError(f"{graph.path}: gives {told}, which are not DETR's boxes (1, Q, 4) and logits (1, Q, C)")
    (boxes,) = fits
    (logits,) = names.keys() - fits
    if not bool(((outputs[boxes] >= 0) & (outputs[boxes] <= 1)).all()):
        raise RaucaError(f"{graph.path}: its boxes {names[boxes]} are not fractions of the image, as DETR's are")
    return boxes, logits


def _config(graph: OnnxGraph) -> dict[str, object]:
    path = graph.path.parent / "config.json"
    return read_json(path) if path.is_file() else {}


def _named(config: dict[str, object]) -> tuple[str, ...]:
    """The configuration's names by index."""
    names = config.get("id2label")
    if not isinstance(names, dict):
        return ()
    return tuple(canonical(str(names.get(str(index), GAP))) for index in range(len(names)))


def _usual(columns: int) -> tuple[str, ...]:
    """COCO's names: its 80, or its numbers from 0, which none has, to 90."""
    numbered = (GAP, *class_list("coco-91"))
    return {80: class_list("coco-80"), 81: class_list("coco-80"), 91: numbered, 92: numbered}.get(columns, ())


def _scaling(graph: OnnxGraph, size: Shape, imagenet: bool) -> Scaling:
    """As the file beside the graph says; a graph of one size gets that."""
    default = Scaling() if imagenet else Scaling(0, 0, 640, 640, *AS_THEY_ARE)
    found = read_scaling(graph.path.parent / "preprocessor_config.json", default)
    if graph.height and graph.width:
        return replace(found, shortest=0, longest=0, height=size[0], width=size[1])
    return found


def _decode(outputs: Outputs, boxes: int, logits: int, classes: int, softmax: bool) -> DensePredictions:
    found: Tensor = outputs[logits]
    scores = (found.softmax(-1) if softmax else found.sigmoid())[..., :classes]
    return DensePredictions(corners(outputs[boxes]), torch.ones_like(found[..., 0]), scores)
