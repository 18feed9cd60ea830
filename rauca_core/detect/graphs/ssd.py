"""An SSD behind the detector interface, whichever file it came from: its resize, anchors, score columns and network."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, fx, nn
from torch.nn import functional

from ...contract import RaucaError
from ..classes import GAP, class_list
from ..interface import DensePredictions
from ..nms import SinglePassDetector
from .network import Array

MAX_SIZE = 2048  # of the square input, pixels
# exp(10) anchors are wider than any image; beyond that only the gradient would be lost to infinity
MAX_LOG_SIZE = 10.0


@dataclass(frozen=True)
class SsdParts:
    """What the readers of file formats deliver.

    Attributes:
        path: of the network's description; errors name it.
        network: from sRGB (B, 3, size, size) in [0, 1] to encodings, (B, N, 4) or flat, and probabilities, (B, N,
            columns) or flat; column 0 is the background.
        anchors: (N, 4) center x, y, width, height, relative to the image.
        variances: (4,) factors on the encoded x, y, width, height.
        columns: of the scores, the background among them; None where the file does not say.
        size: of the square input, pixels.
        rows_first: encodings are y, x, height, width (TensorFlow) instead of x, y, width, height (caffe).
        half_pixel_centers: see :func:`stretch`.
    """

    path: Path
    network: fx.GraphModule
    anchors: Array
    variances: Array
    columns: int | None
    size: int
    rows_first: bool
    half_pixel_centers: bool


class CenterSizeBoxes(nn.Module):
    """Decodes offsets from anchors (Liu et al. 2016, SSD, eq. 2), see :class:`SsdParts`; all relative to the image."""

    def __init__(self, anchors: Array, variances: Array, rows_first: bool) -> None:
        super().__init__()
        self.order = [1, 0, 3, 2] if rows_first else [0, 1, 2, 3]
        scale = variances * anchors[:, [2, 3, 2, 3]]
        scale[:, 2:] = variances[2:]
        self.scale = nn.Parameter(torch.from_numpy(scale).float(), requires_grad=False)
        self.center = nn.Parameter(torch.from_numpy(anchors[:, :2]).float(), requires_grad=False)
        self.size = nn.Parameter(torch.from_numpy(anchors[:, 2:]).float(), requires_grad=False)

    def forward(self, encodings: Tensor) -> Tensor:
        """(B, N, 4) encodings -> (B, N, 4) xyxy."""
        offset, log_size = (encodings[..., self.order] * self.scale).split(2, -1)
        center = self.center + offset
        half = log_size.clamp(max=MAX_LOG_SIZE).exp() * (self.size / 2)
        return torch.cat([center - half, center + half], -1)


class SsdNetwork(nn.Module):
    """Encodings and scores of all anchors, decoded; weights take no gradient."""

    def __init__(self, parts: SsdParts) -> None:
        super().__init__()
        self.layers = parts.network
        self.boxes = CenterSizeBoxes(parts.anchors, parts.variances, parts.rows_first)

    def forward(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 3, size, size) sRGB -> boxes (B, N, 4) xyxy relative to the image, probabilities (B, N, columns)."""
        boxes, scores = self.layers(images.contiguous(memory_format=torch.channels_last))
        rows = len(images), len(self.boxes.center), -1  # caffe leaves both flat
        return self.boxes(boxes.reshape(rows)), scores.reshape(rows)


class SsdDetector(SinglePassDetector):
    """A single-shot detector with anchors.

    Images are stretched to the network's square, not letterboxed: so the networks were trained. ``objectness`` is one
    everywhere, ``classes`` are the scores without the background, so that their product is the network's own score.

    Attributes:
        size: the network's square input, pixels.
    """

    network: SsdNetwork

    def __init__(self, name: str, parts: SsdParts, class_names: tuple[str, ...], files: tuple[Path, ...]) -> None:
        """Build the network and run it once.

        Raises:
            RaucaError: heads that do not fit the anchors, values that are not finite, another number of classes.
        """
        self.name = name
        self.class_names = tuple(class_names)
        self.size = parts.size
        self._half_pixel_centers = parts.half_pixel_centers
        self._columns = _score_columns(parts, self.class_names)
        self.network = SsdNetwork(parts)
        found = self.network(torch.full((1, 3, self.size, self.size), 0.5))
        if not all(values.isfinite().all() for values in found):
            raise RaucaError(f"{parts.path}: predicts values that are not finite; the file is damaged")
        digests = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
        self.fingerprint = hashlib.sha256(" ".join([*digests, str(self.size), *class_names]).encode()).hexdigest()

    def _predict(self, images: Tensor) -> DensePredictions:
        boxes, scores = self.network(stretch(images, self.size, self._half_pixel_centers))
        height, width = images.shape[2:]
        boxes = boxes * images.new_tensor([width, height, width, height])
        classes = scores[..., 1:] if len(self._columns) == scores.shape[2] - 1 else scores[..., self._columns]
        return DensePredictions(boxes, torch.ones_like(classes[..., 0]), classes)


def _score_columns(parts: SsdParts, class_names: tuple[str, ...]) -> list[int]:
    """The column of each class name, in heads that fit the anchors and what the file declares.

    Names are one per column after the background; or the 80 of COCO in their order for a head of 91.
    """
    count = len(parts.anchors)
    outputs: Any = parts.network.graph.output_node().args[0]
    boxes, scores = (node.meta["value"] for node in outputs)
    rows, columns = boxes.numel() // 4, scores.numel() // max(count, 1)
    if (
        boxes.numel() != 4 * count
        or scores.numel() != columns * count
        or scores.shape[1] not in (count, scores.numel())
    ):
        raise RaucaError(f"{parts.path}: {count} anchors, but heads of {rows} boxes and {scores.numel()} scores")
    if columns != (parts.columns or columns):
        raise RaucaError(f"{parts.path}: {columns} score columns, but {parts.columns} are declared")
    if len(class_names) == columns - 1:
        return list(range(1, columns))
    if len(class_names) == 80 and columns == 91:
        return [label for label, name in enumerate(class_list("coco-91"), 1) if name != GAP]
    also = ", or the 80 of COCO" if columns == 91 else ""
    raise RaucaError(
        f"{parts.path}: the network predicts {columns - 1} classes{also}; {len(class_names)} class names were given"
    )


def stretch(images: Tensor, size: int, half_pixel_centers: bool) -> Tensor:
    """(B, 3, H, W) -> (B, 3, size, size), bilinear; untouched when it already fits. Differentiable.

    Args:
        half_pixel_centers: True samples at (i + 0.5) * scale - 0.5, as OpenCV and TensorFlow 2 do; False at i * scale,
            as ``ResizeBilinear`` in graphs of TensorFlow 1, which moves the picture by (scale - 1) / 2 of its pixels.
    """
    if images.shape[2:] == (size, size):
        return images
    if half_pixel_centers:
        return functional.interpolate(images, size=(size, size), mode="bilinear", align_corners=False)
    return _lerp(_lerp(images, 2, size), 3, size)


def _lerp(images: Tensor, axis: int, size: int) -> Tensor:
    extent = images.shape[axis]
    # float64: i * scale that should be a whole number must not fall on the pixel before it
    position = torch.arange(size, dtype=torch.float64, device=images.device) * (extent / size)
    low = position.floor().long().clamp(max=extent - 1)
    weight = (position - low).to(images.dtype).reshape([-1 if a == axis else 1 for a in range(4)])
    before = images.index_select(axis, low)
    return torch.lerp(before, images.index_select(axis, (low + 1).clamp(max=extent - 1)), weight)
