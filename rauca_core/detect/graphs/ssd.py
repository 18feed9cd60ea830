"""An SSD behind the detector interface, whichever file it came from: its resize, anchors, score columns and network."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from ...contract import RaucaError
from ..dry_run import dry_run
from ..interface import DensePredictions
from ..nms import SinglePassDetector
from .network import IMAGE, Affine, Array, Layer, LayerNetwork, simplify

# exp(10) anchors are wider than any image; beyond that only the gradient would be lost to infinity
MAX_LOG_SIZE = 10.0


class CenterSizeBoxes(nn.Module):
    """Decodes offsets from anchors (Liu et al. 2016, SSD, eq. 2).

    Everything is relative to the image's width and height.
    """

    def __init__(self, anchors: Array, variances: Array, rows_first: bool) -> None:
        """Take what all images share.

        Args:
            anchors: (N, 4) center x, y, width, height.
            variances: (4,) factors on the encoded x, y, width, height.
            rows_first: encodings are y, x, height, width (TensorFlow) instead of x, y, width, height (caffe).
        """
        super().__init__()
        order = [1, 0, 3, 2] if rows_first else [0, 1, 2, 3]
        scale = variances * anchors[:, [2, 3, 2, 3]]
        scale[:, 2:] = variances[2:]
        self.order: Tensor
        self.register_buffer("order", torch.tensor(order), persistent=False)
        self.scale = nn.Parameter(torch.from_numpy(scale).float(), requires_grad=False)
        self.center = nn.Parameter(torch.from_numpy(anchors[:, :2]).float(), requires_grad=False)
        self.size = nn.Parameter(torch.from_numpy(anchors[:, 2:]).float(), requires_grad=False)

    def forward(self, encodings: Tensor) -> Tensor:
        """(B, N, 4) encodings -> (B, N, 4) xyxy."""
        offset, log_size = (encodings[..., self.order] * self.scale).split(2, -1)
        center = self.center + offset
        half = log_size.clamp(max=MAX_LOG_SIZE).exp() * (self.size / 2)
        return torch.cat([center - half, center + half], -1)


# COCO numbers its 80 categories from 1 to 90; these ids were never given out, but heads have columns for them.
COCO_GAPS = frozenset({12, 26, 29, 30, 45, 66, 68, 69, 71, 83})
COCO_IDS = tuple(label for label in range(1, 91) if label not in COCO_GAPS)


def score_columns(path: Path, columns: int, class_names: tuple[str, ...]) -> tuple[int, ...]:
    """The column of each class name.

    Args:
        path: the network's file, for the error.
        columns: of the head, the background among them.
        class_names: one per column after the background; or the 80 names of COCO in their order for a head of 91.

    Raises:
        RaucaError: another number of names.
    """
    if len(class_names) == columns - 1:
        return tuple(range(1, columns))
    if len(class_names) == len(COCO_IDS) and columns == 91:
        return COCO_IDS
    also = f", or the {len(COCO_IDS)} of COCO" if columns == 91 else ""
    raise RaucaError(
        f"{path}: the network predicts {columns - 1} classes{also}; {len(class_names)} class names were given"
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


@dataclass(frozen=True)
class SsdParts:
    """What the readers of file formats deliver.

    Attributes:
        path: of the network's description; errors name it.
        layers: from the normalized image (B, 3, size, size) to the two values below.
        boxes: the value with the encodings, (B, N, 4) or (B, N * 4).
        scores: the value with the probabilities, (B, N, columns) or (B, N * columns); column 0 is the background.
        anchors: (N, 4) center x, y, width, height, relative to the image.
        variances: (4,) factors on the encoded x, y, width, height.
        columns: of the scores, the background among them; None where the file does not say.
        normalization: (scale, shift) from sRGB in [0, 1] to what the layers take.
        size: of the square input, pixels.
        rows_first: encodings are y, x, height, width.
        blue_first: the network takes BGR.
        half_pixel_centers: see :func:`rauca_core.detect.graphs.ssd.stretch`.
    """

    path: Path
    layers: list[Layer]
    boxes: str
    scores: str
    anchors: Array
    variances: Array
    columns: int | None
    normalization: tuple[float, float]
    size: int
    rows_first: bool
    blue_first: bool
    half_pixel_centers: bool


class SsdDetector(SinglePassDetector):
    """A single-shot detector with anchors.

    Images are stretched to the network's square, not letterboxed: so the networks were trained. ``objectness`` is one
    everywhere, ``classes`` are the scores without the background, so that their product is the network's own score.

    Attributes:
        name, class_names, fingerprint: see :class:`rauca_core.detect.Detector`.
        size: the network's square input, pixels.
        network: the differentiable layers; their weights take no gradient.
    """

    network: LayerNetwork

    def __init__(self, name: str, parts: SsdParts, class_names: tuple[str, ...], files: tuple[Path, ...]) -> None:
        """Build the network and run it once.

        Raises:
            RaucaError: layers whose shapes do not fit together, another number of anchors or classes.
        """
        self.name = name
        self.class_names = tuple(class_names)
        self.size = parts.size
        self._parts = replace(parts, layers=[])  # their weights are the network's now
        outputs = (parts.boxes, parts.scores)
        self.network = LayerNetwork(simplify(_with_normalization(parts), outputs), outputs)
        self.boxes = CenterSizeBoxes(parts.anchors, parts.variances, parts.rows_first)
        self._columns = torch.tensor(score_columns(parts.path, self._count_columns(), self.class_names))
        self.fingerprint = _fingerprint(files, self.size, self.class_names)

    def _count_columns(self) -> int:
        """Score columns of a first run, which also proves that everything fits together."""
        count = len(self._parts.anchors)
        dry_run(self._parts.path, self.network, self.size)
        with torch.no_grad():
            try:
                boxes, scores = self._heads(torch.full((1, 3, self.size, self.size), 0.5))
            except (RuntimeError, IndexError) as error:
                reason = str(error).splitlines()[0]
                raise RaucaError(f"{self._parts.path}: the layers' shapes do not fit together ({reason})") from error
        if boxes.shape != (1, count, 4) or scores.shape[:2] != (1, count):
            raise RaucaError(
                f"{self._parts.path}: {count} anchors, but heads of {boxes.shape[1]} boxes and {scores.shape[1]} scores"
            )
        if not (boxes.isfinite().all() and scores.isfinite().all()):
            raise RaucaError(f"{self._parts.path}: predicts values that are not finite; the file is damaged")
        if scores.shape[2] != (self._parts.columns or scores.shape[2]):
            raise RaucaError(
                f"{self._parts.path}: {scores.shape[2]} score columns, but {self._parts.columns} are declared"
            )
        return scores.shape[2]

    def _heads(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 3, size, size) sRGB -> encodings (B, N, 4), probabilities (B, N, columns)."""
        boxes, scores = self.network(images.flip(1) if self._parts.blue_first else images)
        if scores.ndim == 2:  # caffe leaves them flat
            scores = scores.reshape(len(images), len(self._parts.anchors), -1)
        return boxes.reshape(len(images), -1, 4), scores

    def to(self, device: torch.device | str) -> Self:
        """Move the network to a device; returns self."""
        self.network.to(device)
        self.boxes.to(device)
        self._columns = self._columns.to(device)
        return self

    def _predict(self, images: Tensor) -> DensePredictions:
        encodings, scores = self._heads(stretch(images, self.size, self._parts.half_pixel_centers))
        height, width = images.shape[2:]
        boxes = self.boxes(encodings) * images.new_tensor([width, height, width, height])
        classes = scores[..., 1:] if len(self._columns) == scores.shape[2] - 1 else scores[..., self._columns]
        return DensePredictions(boxes, torch.ones_like(classes[..., 0]), classes)


def _with_normalization(parts: SsdParts) -> list[Layer]:
    """The layers behind an affine map; never inside the first convolution, whose zero padding is of its input."""
    scale, shift = (np.array(number) for number in parts.normalization)
    first = Affine(":normalized", (IMAGE,), scale, shift)
    renamed = {IMAGE: first.name}
    return [
        first,
        *(replace(layer, inputs=tuple(renamed.get(name, name) for name in layer.inputs)) for layer in parts.layers),
    ]


def _fingerprint(files: tuple[Path, ...], size: int, class_names: tuple[str, ...]) -> str:
    digests = [hashlib.sha256(file.read_bytes()).hexdigest() for file in files]
    return hashlib.sha256(" ".join([*digests, str(size), *class_names]).encode()).hexdigest()
