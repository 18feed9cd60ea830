"""An SSD behind the detector interface, whichever file it came from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
import torch
from torch import Tensor

from ...contract import RaucaError
from ..dry_run import dry_run
from ..interface import DensePredictions
from ..single_pass import SinglePassDetector
from .boxes import CenterSizeBoxes
from .fold import simplify
from .labels import score_columns
from .layers import IMAGE, Affine, Array, Layer
from .network import LayerNetwork
from .resize import stretch


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
        half_pixel_centers: see :func:`rauca_core.detect.graphs.resize.stretch`.
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
