"""Detectors of ONNX files: the YOLOX family and Ultralytics' exports (v5, v8, v11)."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn

from ..contract import RaucaError
from .classes import class_list, require_names, unusual_names
from .darknet_network import MAX_LOG_SIZE, precise
from .families import Resolved
from .foreign import first_line
from .interface import DensePredictions, check_images, in_type_of
from .letterbox import Letterbox
from .nms import SinglePassDetector, corners
from .onnx_fusion import fuse
from .onnx_graph import OnnxGraph, Session, read_graph, to_torch

DEFAULT_SIZE = 640
MAX_SIZE = 4096  # the largest published exports take 1536
LARGEST_DIFFERENCE = 1e-3  # between the runtimes, of the largest output; rounding makes 1e-6
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


class OnnxDetector(SinglePassDetector):
    """An ONNX graph behind :class:`rauca_core.detect.Detector`.

    Where a gradient is wanted the graph runs in torch, converted by onnx2torch; on the CPU without one it runs in
    onnxruntime, several times as fast. The two are compared when the graph is loaded. A graph that cannot be converted
    is not ``differentiable``: :meth:`dense` refuses images that want a gradient, and it stays on the CPU.

    Attributes:
        size: the graph's square input, pixels.
        network: the graph in torch, if it can be converted.
        differentiable: gradients flow from the predictions to the images.
    """

    def __init__(
        self,
        name: str,
        path: Path,
        class_names: tuple[str, ...] | None = None,
        size: int | None = None,
        family: GraphFamily | None = None,
    ) -> None:
        """Read the graph and run it once, so that one which cannot run is met here.

        Args:
            class_names: those in the file, or COCO's for 80 classes, unless given.
            size: for graphs whose input size is open: a multiple of 32, 640 or what the file says unless given.
            family: where the output's shape alone does not say; see :func:`find_layout`.

        Raises:
            RaucaError: everything :func:`read_graph` refuses; another input size than the graph's; an output that is
                none of the known layouts; a class list of another length.
        """
        graph = read_graph(path)
        self.name = name
        self.size = _input_size(graph, size)
        if graph.batch not in (1, None):
            raise RaucaError(f"{path}: exported for batches of {graph.batch}; export it with batch 1 or an open batch")
        self._session = Session(graph)
        image = torch.rand(1, 3, self.size, self.size, generator=torch.Generator().manual_seed(0))
        output = self._session(image)
        self._one_by_one = graph.batch == 1 or not _takes_batches(self._session, image)
        family = family or ("ultralytics" if graph.class_names else None)
        self._layout = find_layout(path, tuple(output.shape), self.size, "Exp" in graph.operators, family)
        self.class_names = _class_names(graph, self._layout.classes, class_names)
        self.network, self._why_not = _differentiable(graph, image, output)
        settings = f"{graph.sha256} {self.size} {self._layout.yolox}{unusual_names(self.class_names)}"
        self.fingerprint = hashlib.sha256(settings.encode()).hexdigest()

    @property
    def differentiable(self) -> bool:
        return self.network is not None

    def dense(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1]; gradients flow to ``images`` if ``differentiable``."""
        if not self.differentiable and images.requires_grad and torch.is_grad_enabled():
            raise RaucaError(f"{self.name}: has no gradients; {self._why_not}")
        return super().dense(images)

    def _predict(self, images: Tensor) -> DensePredictions:
        box = self._layout.letterbox(images.shape[2], images.shape[3], self.size)
        return box.predict(
            images, lambda fitted: self._layout.decode(precise(self._forward(self._layout.prepare(fitted))))
        )

    def _checked(self, images: Tensor, waits: bool = False) -> Tensor:
        check_images(self.name, images, waits)
        weights = in_type_of(self.network, images[:0]).dtype  # of 16 bits, exports keep an input of 32
        return images.to(torch.promote_types(weights, torch.float32))

    def _forward(self, prepared: Tensor) -> Tensor:
        wants_gradient = prepared.requires_grad and torch.is_grad_enabled()
        in_torch = wants_gradient or prepared.device.type != "cpu" or prepared.dtype != torch.float32
        run = self.network if in_torch and self.network is not None else self._session
        if self._one_by_one and len(prepared) > 1:
            return torch.cat([run(one) for one in prepared.split(1)])
        found: Tensor = run(prepared)
        return found


def load(found: Resolved, size: int | None) -> OnnxDetector:
    """Of a graph, which may name its classes itself."""
    family: GraphFamily | None = "yolox" if found.network == "yolox" else None
    return OnnxDetector(found.name, found.files[0], found.class_names, size, family)


def _takes_batches(session: Session, image: Tensor) -> bool:
    """Some exports say that their batch is open but have its size of 1 in their reshapes."""
    try:
        return len(session(image.repeat(2, 1, 1, 1))) == 2
    except RaucaError:
        return False


def _differentiable(graph: OnnxGraph, image: Tensor, expected: Tensor) -> tuple[nn.Module | None, str]:
    """The graph in torch, or the reason why there is none."""
    try:
        module = fuse(to_torch(graph))
        with torch.no_grad():
            off = float((module(image) - expected).abs().max() / expected.abs().max().clamp(min=1.0))
    except RaucaError as error:
        return None, str(error)
    except Exception as error:  # whatever the operators of a foreign graph may raise
        return None, f"{graph.path}: onnx2torch's conversion does not run ({first_line(error)})"
    if not off <= LARGEST_DIFFERENCE:
        return None, f"{graph.path}: onnx2torch's conversion is {off:.2g} off what onnxruntime computes"
    return module, ""


def _input_size(graph: OnnxGraph, size: int | None) -> int:
    if graph.height != graph.width:
        raise RaucaError(f"{graph.path}: its input is {graph.height} x {graph.width} pixels, expected a square")
    if graph.height is not None and size not in (None, graph.height):
        raise RaucaError(f"{graph.path}: exported for {graph.height} pixels, not {size}; leave size out")
    chosen = graph.height or size or graph.image_size or DEFAULT_SIZE
    if graph.height is None and (chosen < 32 or chosen % 32):
        raise RaucaError(f"{graph.path}: input size {chosen} must be a multiple of 32 pixels")
    if not 1 <= chosen <= MAX_SIZE:
        raise RaucaError(f"{graph.path}: takes images of {chosen} pixels; at most {MAX_SIZE} are made")
    return chosen


def _class_names(graph: OnnxGraph, classes: int, given: tuple[str, ...] | None) -> tuple[str, ...]:
    names = given or graph.class_names or (class_list("coco-80") if classes == 80 else None)
    if names is None:
        raise RaucaError(
            f"{graph.path}: predicts {classes} classes, whose names are not in it; write a .names file beside it"
        )
    require_names(graph.path, classes, names)
    return names
