"""Detectors of ONNX files: YOLOX, Ultralytics' exports (v5 to 26), DETR's family; see :mod:`.onnx_layouts`."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor, nn

from ..contract import RaucaError
from .classes import class_list, require_names, unusual_names
from .darknet_network import precise
from .families import Resolved
from .foreign import first_line
from .interface import DensePredictions, Detections, check_images, in_type_of
from .nms import SinglePassDetector, of_queries
from .onnx_detr import detr_layout
from .onnx_fusion import fuse
from .onnx_graph import OnnxGraph, Session, read_graph, to_torch
from .onnx_layouts import GraphFamily, Layout, Outputs, Shape, find_layout

DEFAULT_SIZE = 640
MAX_SIZE = 4096  # the largest published exports take 1536
MAX_BATCH = 64  # images of a file that takes no other number; they are made even for one
LARGEST_DIFFERENCE = 1e-3  # between the runtimes, of the largest output; rounding makes 1e-6
_LOG = logging.getLogger(__name__)


class OnnxDetector(SinglePassDetector):
    """An ONNX graph behind :class:`rauca_core.detect.Detector`.

    Where a gradient is wanted the graph runs in torch, converted by onnx2torch; on the CPU without one it runs in
    onnxruntime, several times as fast. The two are compared when the graph is loaded. A graph that cannot be converted
    is not ``differentiable``: :meth:`dense` refuses images that want a gradient, and it stays on the CPU.

    A graph that suppresses for itself has final detections only: ``detect`` gives them as they are, above the caller's
    score threshold, and ``dense`` refuses. Nor does ``detect`` suppress what DETR's family says: ``iou_threshold`` is
    unused.

    Attributes:
        size: the longer side of the graph's input, pixels; ``shape`` is its (height, width).
        kind: what the graph was recognized as, for people.
        network: the graph in torch, if it can be converted.
        differentiable: gradients flow from the predictions to the images.
        obstacle: why they do not; empty if they do.
        layout: how the graph is fed and read.
        torch_batch: how many images ``network`` takes at once; None for any number.
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
            size: for graphs whose input size is open: a square's side, a multiple of 32; what the file says, or 640,
                unless given.
            family: where the output's shape alone does not say; see :func:`find_layout`.

        Raises:
            RaucaError: everything :func:`read_graph` refuses; another input size than the graph's; an output that is
                none of the known layouts; a class list of another length.
        """
        graph = read_graph(path)
        self.name, self.shape = name, _input_shape(graph, size)
        self.size = max(self.shape)
        if graph.batch and graph.batch > MAX_BATCH:
            raise RaucaError(f"{path}: takes {graph.batch} images at once; export it for at most {MAX_BATCH}, or for 1")
        self._session = Session(graph)
        image = torch.rand(1, 3, *self.shape, generator=torch.Generator().manual_seed(0))
        image = image.expand(graph.batch or 1, -1, -1, -1)
        outputs = self._session(image)
        self._batch = graph.batch or (None if _takes_batches(self._session, image) else 1)
        family = family or ("ultralytics" if graph.class_names else None)
        names = class_names or graph.class_names
        found = find_layout(graph, outputs, self.shape, family, len(names or ()))
        if found is None:
            found, names = detr_layout(graph, outputs, self.shape, names)
            _LOG.info("%s: read as %s", path, found.kind)
        if found.scaling is not None and size is not None and graph.height is None:
            found = replace(found, scaling=found.scaling.of_size(name, size))
        self.layout, self.kind = found, found.kind
        self.class_names = _class_names(graph, found.classes, names)
        self.network, self.obstacle, one_by_one = _differentiable(graph, found, image, outputs)
        self.torch_batch = graph.batch or 1 if one_by_one else self._batch
        shape = self.size if self.shape == (self.size, self.size) else self.shape
        settings = f"{graph.sha256} {shape} {found.settings}{unusual_names(self.class_names)}"
        self.fingerprint = hashlib.sha256(settings.encode()).hexdigest()

    @property
    def differentiable(self) -> bool:
        return self.network is not None

    def dense(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1]; gradients flow to ``images`` if ``differentiable``.

        Raises:
            RaucaError: a gradient is wanted that the graph does not have, or predictions that it does not give; the
                line says why, and the command that exports another.
        """
        wanted = bool(self.layout.final) or (images.requires_grad and torch.is_grad_enabled())
        if wanted and not self.differentiable:
            raise RaucaError(f"{self.name}: has no gradients; {self.obstacle}")
        return super().dense(images)

    def _predict(self, images: Tensor) -> DensePredictions:
        return self.layout.predict(self.name, images, self.shape, self._forward)

    def _final(self, images: Tensor, score_threshold: float, iou_threshold: float) -> list[Detections]:
        if self.layout.queries:
            return of_queries(self._predict(images), score_threshold, self.layout.exclusive)
        return super()._final(images, score_threshold, iou_threshold)

    def _checked(self, images: Tensor, waits: bool = False) -> Tensor:
        check_images(self.name, images, waits)
        weights = in_type_of(self.network, images[:0]).dtype  # of 16 bits, exports keep an input of 32
        return images.to(torch.promote_types(weights, torch.float32))

    def _forward(self, prepared: Tensor) -> Outputs:
        wants_gradient = prepared.requires_grad and torch.is_grad_enabled()
        in_torch = wants_gradient or prepared.device.type != "cpu" or prepared.dtype != torch.float32
        run = self.network if in_torch and self.network is not None else self._session
        batch = self.torch_batch if run is self.network else self._batch
        return in_batches(run, prepared, batch)


def load(found: Resolved, size: int | None) -> OnnxDetector:
    """Of a graph, which may name its classes itself."""
    families: dict[str, GraphFamily] = {"yolox": "yolox", "ultralytics": "ultralytics"}
    return OnnxDetector(found.name, found.files[0], found.class_names, size, families.get(found.network))


def in_batches(run: Callable[[Tensor], Outputs], images: Tensor, batch: int | None) -> Outputs:
    """What a graph that takes ``batch`` images at once, None for any number, says of any number; float32."""
    parts = [_of_batch(run, part, batch) for part in images.split(batch or len(images))]
    return tuple(precise(torch.cat(part) if len(parts) > 1 else part[0]) for part in zip(*parts, strict=True))


def _of_batch(run: Callable[[Tensor], Outputs], images: Tensor, batch: int | None) -> Outputs:
    """Of a graph that takes ``batch`` images at once: the last one is repeated where there are fewer."""
    missing = (batch or 0) - len(images)
    if missing <= 0:
        return run(images)
    found = run(torch.cat([images, images[-1:].expand(missing, -1, -1, -1)]))
    return tuple(one[: len(images)] for one in found)


def _takes_batches(session: Session, image: Tensor) -> bool:
    """Some exports say that their batch is open but have its size of 1 in their reshapes."""
    try:
        return all(len(one) == 2 for one in session(image.repeat(2, 1, 1, 1)))
    except RaucaError:
        return False


def _differentiable(
    graph: OnnxGraph, layout: Layout, image: Tensor, expected: Outputs
) -> tuple[nn.Module | None, str, bool]:
    """The graph in torch, or the reason why there is none; and whether it takes no other batch than the image's."""
    if layout.final:
        why = f"{graph.path} ends in its own choice of detections, all others are lost"
        return None, f"{why}; one to be attacked: {layout.final}", False
    if graph.half:
        return None, f"{graph.path} computes in 16 bits; export it with half=False", False
    sides = image.shape[2:] if layout.scaling is None else (layout.scaling.height or None, layout.scaling.width or None)
    why = ""
    for shape in (None, (len(image), 3, *sides)):
        module, reason = _converted(graph, shape, image, expected, layout.queries)
        if module is not None:
            return module, "", shape is not None
        why = why or reason
    return None, why, False


def _converted(
    graph: OnnxGraph, shape: Sequence[int | None] | None, image: Tensor, expected: Outputs, queries: bool
) -> tuple[nn.Module | None, str]:
    """The graph in torch, for inputs of ``shape`` if given, where it computes what was ``expected`` of the image."""
    try:
        module = fuse(to_torch(graph, shape))
        with torch.no_grad():
            found = module(image)
        off = max(largest_difference(*pair, queries) for pair in zip(found, expected, strict=True))
    except RaucaError as error:
        return None, str(error)
    except Exception as error:  # whatever the operators of a foreign graph may raise
        return None, f"{graph.path}: onnx2torch's conversion does not run ({first_line(error)})"
    if not off <= LARGEST_DIFFERENCE:
        return None, f"{graph.path}: onnx2torch's conversion is {off:.2g} off what onnxruntime computes"
    return module, ""


def largest_difference(found: Tensor, expected: Tensor, queries: bool = False) -> float:
    """As a part of the largest value. Queries that are equal but for rounding may come in any order."""
    if found.shape != expected.shape:
        return float("inf")
    if queries:
        found, expected = (one.sort(1).values for one in (found, expected))
    return float((found - expected).abs().max() / expected.abs().max().clamp(min=1.0))


def _input_shape(graph: OnnxGraph, size: int | None) -> Shape:
    """(height, width) of the input, pixels."""
    fixed = graph.height, graph.width
    if size is not None and any(side not in (None, size) for side in fixed):
        made = " x ".join(str(side) for side in sorted({side for side in fixed if side}))
        raise RaucaError(f"{graph.path}: exported for {made} pixels, not {size}; leave size out")
    usual = (size, size) if size else graph.image_shape or (DEFAULT_SIZE, DEFAULT_SIZE)
    height, width = (own or other for own, other in zip(fixed, usual, strict=True))
    for side, own in zip((height, width), fixed, strict=True):
        if own is None and (side < 32 or side % 32):
            raise RaucaError(f"{graph.path}: input size {side} must be a multiple of 32 pixels")
        if not 1 <= side <= MAX_SIZE:
            raise RaucaError(f"{graph.path}: takes images of {side} pixels; at most {MAX_SIZE} are made")
    return height, width


def _class_names(graph: OnnxGraph, classes: int, given: tuple[str, ...] | None) -> tuple[str, ...]:
    names = given or graph.class_names or (class_list("coco-80") if classes == 80 else None)
    if names is None:
        raise RaucaError(
            f"{graph.path}: predicts {classes} classes, whose names are not in it; write a .names file beside it"
        )
    require_names(graph.path, classes, names)
    return names
