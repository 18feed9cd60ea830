"""What the families of ONNX detectors expect and what they put out."""

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
from .interface import DensePredictions
from .letterbox import Letterbox
from .nms import corners

STRIDES = ((8, 16, 32), (8, 16, 32, 64))
GREY = 114 / 255
GraphFamily = Literal["yolox", "ultralytics"]


@dataclass(frozen=True)
class Layout:
    """How to feed a graph and read it.

    Attributes:
        classes: how many categories it tells apart.
        yolox: wants BGR in 0..255 in the top left corner, rather than RGB in 0..1 in the middle.
        decode: the graph's output to predictions, boxes in pixels of its input.
    """

    classes: int
    yolox: bool
    decode: Callable[[Tensor], DensePredictions]

    def letterbox(self, height: int, width: int, size: int) -> Letterbox:
        return Letterbox(height, width, size, centered=not self.yolox, padding_srgb=GREY)

    def prepare(self, fitted: Tensor) -> Tensor:
        """sRGB (B, 3, size, size) in [0, 1] to what the graph was trained on; neither family normalizes further."""
        return fitted.flip(1) * 255.0 if self.yolox else fitted


def find_layout(path: Path, shape: tuple[int, ...], size: int, decoded: bool, family: GraphFamily | None) -> Layout:
    """The layout of the output (B, rows, columns) of the graph ``path`` for square inputs of ``size`` pixels.

    Args:
        decoded: the graph holds YOLOX's exponential, so its boxes are in pixels already.
        family: when it is known; YOLOX otherwise if the rows are its cells.

    Raises:
        RaucaError: it is none of ours.
    """
    _, rows, columns = shape if len(shape) == 3 else (0, 0, 0)
    for strides in STRIDES:
        cells = sum((size // stride) ** 2 for stride in strides)
        if columns == cells and rows > 4 and family != "yolox":
            return Layout(rows - 4, False, decode_v8)
        if rows == cells and columns > 5 and family != "ultralytics":
            return Layout(
                columns - 5, True, decode_v5 if decoded else partial(decode_yolox, size=size, strides=strides)
            )
        if rows == 3 * cells and columns > 5 and family != "yolox":
            return Layout(columns - 5, False, decode_v5)
    raise RaucaError(
        f"{path}: its output {shape} is neither YOLOX's (1, N, 5 + C), YOLOv5's (1, 3 N, 5 + C) "
        f"nor YOLOv8's (1, 4 + C, N) for {size} pixels; export without non-maximum suppression"
    )


def decode_yolox(output: Tensor, size: int, strides: tuple[int, ...]) -> DensePredictions:
    """(B, cells, 5 + C): center relative to its cell in cells, log of the size in cells, objectness, classes."""
    places, scales = _grid(size, strides, output)
    center = (output[..., :2] + places) * scales
    half = 0.5 * output[..., 2:4].clamp(max=MAX_LOG_SIZE).exp() * scales
    return DensePredictions(torch.cat([center - half, center + half], -1), output[..., 4], output[..., 5:])


def decode_v5(output: Tensor) -> DensePredictions:
    """(B, N, 5 + C): center and size in pixels, objectness, classes."""
    return DensePredictions(corners(output[..., :4]), output[..., 4], output[..., 5:])


def decode_v8(output: Tensor) -> DensePredictions:
    """(B, 4 + C, N): center and size in pixels, classes; no objectness."""
    output = output.transpose(1, 2)
    return DensePredictions(corners(output[..., :4]), torch.ones_like(output[..., 0]), output[..., 4:])


def _grid(size: int, strides: tuple[int, ...], like: Tensor) -> tuple[Tensor, Tensor]:
    """Column and row of every cell (cells, 2), and its side in pixels (cells, 1); row by row, fine strides first."""
    places, scales = [], []
    for stride in strides:
        steps = torch.arange(size // stride, dtype=like.dtype, device=like.device)
        rows, columns = torch.meshgrid(steps, steps, indexing="ij")
        places.append(torch.stack([columns, rows], -1).view(-1, 2))
        scales.append(torch.full_like(places[-1][:, :1], stride))
    return torch.cat(places), torch.cat(scales)
