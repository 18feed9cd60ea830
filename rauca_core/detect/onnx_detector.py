"""Detectors of ONNX files: the YOLOX family and Ultralytics' exports (v5, v8, v11)."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor, nn

from ..contract import RaucaError
from .checks import check_images
from .classes import class_list
from .interface import DensePredictions, Detections
from .nms import clipped, detections
from .onnx_fusion import fuse
from .onnx_graph import OnnxGraph, extra, read_graph, to_torch
from .onnx_layouts import GraphFamily, Layout, find_layout

DEFAULT_SIZE = 640


class OnnxDetector:
    """An ONNX graph behind :class:`rauca_core.detect.Detector`.

    The graph runs in torch, with gradients. One that onnx2torch cannot convert runs in onnxruntime on the CPU:
    ``differentiable`` is then False and :meth:`dense` refuses images that want a gradient.

    Attributes:
        name, class_names, fingerprint: see :class:`rauca_core.detect.Detector`.
        size: the graph's square input, pixels.
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
        """Read the graph and run it once on a grey image.

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
        self._one_by_one = graph.batch == 1
        self._module, self._run, self._why_not = _runner(graph)
        self.differentiable = self._module is not None
        self._layout = self._probe(graph, family or ("ultralytics" if graph.class_names else None))
        self.class_names = _class_names(graph, self._layout.classes, class_names)
        runtime = "torch" if self.differentiable else "onnxruntime"
        self.fingerprint = hashlib.sha256(
            f"{graph.sha256} {self.size} {self._layout.yolox} {runtime}".encode()
        ).hexdigest()

    def to(self, device: torch.device | str) -> OnnxDetector:
        """Move the network to a device; returns self. A graph in onnxruntime stays on the CPU."""
        if self._module is not None:
            self._module.to(device)
        return self

    def dense(self, images: Tensor) -> DensePredictions:
        """Predict from sRGB images (B, 3, H, W) in [0, 1]; gradients flow to ``images`` if ``differentiable``."""
        check_images(self.name, images)
        if not self.differentiable and images.requires_grad and torch.is_grad_enabled():
            raise RaucaError(f"{self.name}: has no gradients; {self._why_not}")
        return self._predict(images)

    @torch.inference_mode()
    def detect(self, images: Tensor, score_threshold: float = 0.005, iou_threshold: float = 0.45) -> list[Detections]:
        """Final detections per image, boxes clipped to it; see :class:`rauca_core.detect.Detector`."""
        check_images(self.name, images, waits=True)
        return clipped(detections(self._predict(images), score_threshold, iou_threshold), images)

    def _predict(self, images: Tensor) -> DensePredictions:
        box = self._layout.letterbox(images.shape[2], images.shape[3], self.size)
        found = self._layout.decode(self._forward(self._layout.prepare(box.fit(images))))
        found.boxes = box.boxes_to_image(found.boxes)
        return found

    def _forward(self, prepared: Tensor) -> Tensor:
        if self._one_by_one and len(prepared) > 1:
            return torch.cat([self._run(one) for one in prepared.split(1)])
        return self._run(prepared)

    @torch.inference_mode()
    def _probe(self, graph: OnnxGraph, family: GraphFamily | None) -> Layout:
        """Run the graph once, so that one which cannot run is met here, and see what comes out."""
        try:
            output = self._run(torch.full((1, 3, self.size, self.size), 0.5))
        except Exception as error:  # whatever the operators of a foreign graph may raise
            reason = str(error).strip().splitlines()[:1] or [type(error).__name__]
            raise RaucaError(
                f"{graph.path}: does not run on images of {self.size} pixels ({reason[0][:200]})"
            ) from error
        layout = find_layout(tuple(output.shape), self.size, "Exp" in graph.operators, family)
        if layout is None:
            raise RaucaError(
                f"{graph.path}: its output {tuple(output.shape)} is neither YOLOX's (1, N, 5 + C), "
                f"YOLOv5's (1, 3 N, 5 + C) nor YOLOv8's (1, 4 + C, N) for {self.size} pixels; "
                "export without non-maximum suppression"
            )
        return layout


def _runner(graph: OnnxGraph) -> tuple[nn.Module | None, Callable[[Tensor], Tensor], str]:
    """The graph in torch, or else in onnxruntime with the reason."""
    try:
        module = fuse(to_torch(graph))
    except RaucaError as error:
        return None, _onnxruntime(graph, str(error)), str(error)

    def run(images: Tensor) -> Tensor:
        found = module(images)
        return found[0] if isinstance(found, list | tuple) else found

    return module, run, ""


def _onnxruntime(graph: OnnxGraph, why: str) -> Callable[[Tensor], Tensor]:
    onnxruntime = extra("onnxruntime")
    try:
        session = onnxruntime.InferenceSession(graph.model.SerializeToString(), providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's errors have no common base
        reason = str(error).strip().splitlines()[0][:200]
        raise RaucaError(f"{why}, nor can onnxruntime run it ({reason})") from error

    def run(images: Tensor) -> Tensor:
        fed = {graph.input_name: images.detach().float().cpu().numpy()}
        return torch.from_numpy(session.run([graph.output_names[0]], fed)[0]).to(images.device)

    return run


def _input_size(graph: OnnxGraph, size: int | None) -> int:
    if graph.height != graph.width:
        raise RaucaError(f"{graph.path}: its input is {graph.height} x {graph.width} pixels, expected a square")
    if graph.height is not None:
        if size not in (None, graph.height):
            raise RaucaError(f"{graph.path}: exported for {graph.height} pixels, not {size}; leave size out")
        return graph.height
    size = size or graph.image_size or DEFAULT_SIZE
    if size < 32 or size % 32:
        raise RaucaError(f"{graph.path}: input size {size} must be a multiple of 32 pixels")
    return size


def _class_names(graph: OnnxGraph, classes: int, given: tuple[str, ...] | None) -> tuple[str, ...]:
    names = given or graph.class_names or (class_list("coco-80") if classes == 80 else None)
    if names is None:
        raise RaucaError(
            f"{graph.path}: predicts {classes} classes, whose names are not in it; write a .names file beside it"
        )
    if len(names) != classes:
        raise RaucaError(f"{graph.path}: predicts {classes} classes, {len(names)} names were given")
    return names
