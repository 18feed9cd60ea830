"""The detector that a darknet cfg and weights file make."""

from __future__ import annotations

import hashlib
from pathlib import Path

import torch
from torch import Tensor

from ..contract import RaucaError
from .classes import unusual_names
from .dry_run import require_fit
from .interface import DensePredictions
from .letterbox import Letterbox
from .network import DarknetNetwork
from .single_pass import SinglePassDetector
from .weights_file import read_weights

# As the networks were published; a cfg may state 608, for which the tiny ones gain little.
DEFAULT_SIZE = 416


class DarknetDetector(SinglePassDetector):
    """A YOLOv2, v3 or v4 network behind :class:`rauca_core.detect.Detector`.

    Attributes:
        name, class_names, fingerprint: see :class:`rauca_core.detect.Detector`.
        size: the network's square input, pixels.
        network: the differentiable module; its weights take no gradient.
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
        if len(class_names) != self.network.classes:
            raise RaucaError(
                f"{cfg}: the network predicts {self.network.classes} classes, {len(class_names)} names were given"
            )
        if size < self.network.stride or size % self.network.stride:
            raise RaucaError(f"{name}: input size {size} must be a multiple of {self.network.stride} pixels")
        require_fit(cfg, self.network.shapes(size), size)
        weights_sha256 = read_weights(weights, self.network)
        self.name = name
        self.class_names = class_names
        self.size = size
        settings = f"{hashlib.sha256(cfg.read_bytes()).hexdigest()} {weights_sha256} {size}{unusual_names(class_names)}"
        self.fingerprint = hashlib.sha256(settings.encode()).hexdigest()

    def to(self, device: torch.device | str) -> DarknetDetector:
        """Move the network to a device; returns self."""
        self.network.to(device)
        return self

    def _predict(self, images: Tensor) -> DensePredictions:
        box = Letterbox(images.shape[2], images.shape[3], self.size)
        found: DensePredictions = self.network(box.fit(images))
        found.boxes = box.boxes_to_image(found.boxes)
        return found
