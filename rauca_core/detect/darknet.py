"""The detector that a darknet cfg and weights file make.

Layout of the weights: three int32 (major, minor, revision), the images seen during training (int64 from version 0.2,
int32 before), then float32 per convolution in order: bias, [scale, mean, variance], kernel.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import RaucaError
from ..contract.files import file_digest
from ..contract.reading import require_file
from .classes import require_names, unusual_names
from .darknet_network import Convolution, DarknetNetwork
from .dry_run import dry_run
from .families import Resolved
from .interface import DensePredictions
from .letterbox import Letterbox
from .nms import SinglePassDetector

BN_EPSILON = 1e-6


def read_weights(path: Path, network: DarknetNetwork) -> str:
    """Fill ``network`` from a weights file; batch normalization is folded.

    Returns:
        The file's sha256.

    Raises:
        RaucaError: missing file, a size that does not fit the network (both are stated), values that are not finite.
    """
    convolutions = [layer for layer in network.layers if isinstance(layer, Convolution)]
    values = _read_values(path, sum(_count(layer) for layer in convolutions))
    if not np.isfinite(values).all():
        raise RaucaError(f"{path}: holds values that are not finite; the file is damaged, fetch it again")
    start = 0
    for layer in convolutions:
        _fill(layer, values[start : start + _count(layer)])
        start += _count(layer)
    return file_digest(path)


def _count(layer: Convolution) -> int:
    return layer.bias.numel() * (4 if layer.normalized else 1) + layer.weight.numel()


def _read_values(path: Path, count: int) -> NDArray[np.float32]:
    require_file(path)
    try:
        found = path.stat().st_size
        with path.open("rb") as stream:
            version = np.fromfile(stream, "<i4", 3)
            header = 20 if len(version) == 3 and version[0] * 10 + version[1] >= 2 else 16
            expected = header + 4 * count
            if found != expected:
                raise RaucaError(
                    f"{path}: expected {expected} bytes for this network, found {found}; "
                    "the file is cut off or belongs to another cfg"
                )
            stream.seek(header)
            return np.fromfile(stream, "<f4", count)
    except OSError as error:
        raise RaucaError(f"{path}: cannot be read ({error.strerror})") from error


def _fill(layer: Convolution, values: NDArray[np.float32]) -> None:
    """float64 while folding: a variance near zero makes scales of 1e3 that would cost digits in float32."""
    filters = layer.bias.numel()
    bias = values[:filters].astype(np.float64)
    kernel = values[values.size - layer.weight.numel() :].astype(np.float64).reshape(layer.weight.shape)
    if layer.normalized:
        scale, mean, variance = values[filters : 4 * filters].astype(np.float64).reshape(3, filters)
        gain = scale / np.sqrt(np.maximum(variance, 0.0) + BN_EPSILON)
        bias = bias - mean * gain
        kernel = kernel * gain[:, None, None, None]
    with torch.no_grad():
        layer.bias.copy_(torch.from_numpy(bias))
        layer.weight.copy_(torch.from_numpy(kernel))


# As the networks were published; a cfg may state 608, for which the tiny ones gain little.
DEFAULT_SIZE = 416


class DarknetDetector(SinglePassDetector):
    """A YOLOv2, v3 or v4 network behind :class:`rauca_core.detect.Detector`.

    Attributes:
        size: the network's square input, pixels.
    """

    network: DarknetNetwork

    def __init__(
        self, name: str, cfg: Path, weights: Path, class_names: tuple[str, ...], size: int | None = None
    ) -> None:
        """Build the network of ``cfg`` and read ``weights``; ``size`` is 416 unless given.

        Raises:
            RaucaError: anything wrong with the files, a class list of another length, a size the network cannot take.
        """
        size = DEFAULT_SIZE if size is None else size
        self.network = DarknetNetwork(cfg)
        require_names(cfg, self.network.classes, class_names)
        if size < self.network.stride or size % self.network.stride:
            raise RaucaError(f"{name}: input size {size} must be a multiple of {self.network.stride} pixels")
        dry_run(cfg, self.network, size)
        weights_sha256 = read_weights(weights, self.network)
        self.name, self.class_names, self.size = name, class_names, size
        settings = f"{hashlib.sha256(cfg.read_bytes()).hexdigest()} {weights_sha256} {size}{unusual_names(class_names)}"
        self.fingerprint = hashlib.sha256(settings.encode()).hexdigest()

    def _predict(self, images: Tensor) -> DensePredictions:
        return Letterbox(images.shape[2], images.shape[3], self.size).predict(images, self.network)


def load(found: Resolved, size: int | None) -> DarknetDetector:
    """Of weights and a cfg."""
    weights, cfg = found.files
    return DarknetDetector(found.name, cfg, weights, found.names, size)
