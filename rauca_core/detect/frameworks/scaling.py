"""How a model of a framework wants its images, as differentiable torch operations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from ...contract import RaucaError
from ...contract.reading import parse_json, read_text

MAX_CONFIG_BYTES = 2**22  # transformers' have some kB, MMDetection's dumps some 100

AS_THEY_ARE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)  # mean and std
_LONGEST = 1333 / 800
_MODES = {2: "bilinear", 3: "bicubic"}  # Pillow's numbers


@dataclass(frozen=True)
class Scaling:
    """Resizing and normalization of sRGB images.

    Attributes:
        shortest, longest: pixels of the shorter side, unless the longer one would exceed ``longest``; 0 where images
            are scaled to ``height`` and ``width`` whatever their aspect.
        height, width: pixels; 0 where the aspect is kept.
        mean, std: subtracted from and divided into the channels.
        mode: ``"bilinear"`` or ``"bicubic"``, both with antialiasing.
        multiple: sides of a kept aspect are rounded down to multiples of it, pixels.
    """

    shortest: int = 800
    longest: int = 1333
    height: int = 0
    width: int = 0
    mean: tuple[float, ...] = (0.485, 0.456, 0.406)  # ImageNet's
    std: tuple[float, ...] = (0.229, 0.224, 0.225)
    mode: str = "bilinear"
    multiple: int = 1

    def of_size(self, name: str, size: int) -> Scaling:
        """The same kind of scaling for another size: the shorter side's, or both; refused for the detector ``name``."""
        if size < 32 or (not self.shortest and size % 32):
            needed = "at least 32 pixels" if self.shortest else "a multiple of 32 pixels"
            raise RaucaError(f"{name}: input size {size} must be {needed}")
        if self.shortest:
            return replace(self, shortest=size, longest=round(size * _LONGEST))
        return replace(self, height=size, width=size)

    def fit(self, name: str, images: Tensor) -> Tensor:
        """(B, 3, H, W) sRGB in [0, 1] to the network's input; the same numbers as transformers' image processors.

        Raises:
            RaucaError: names the detector ``name``: images so narrow that no pixel of the shorter side would be left.
        """
        size = self.size_of(images.shape[2], images.shape[3])
        if min(size) < 1:
            raise RaucaError(f"{name}: images of {images.shape[3]} x {images.shape[2]} pixels are too narrow")
        if size != tuple(images.shape[2:]):
            images = functional.interpolate(images, size, mode=self.mode, align_corners=False, antialias=True)
        return normalized(images, self.mean, self.std)

    def size_of(self, height: int, width: int) -> tuple[int, int]:
        """(height, width) that an image is scaled to; rounded as transformers rounds."""
        if not self.shortest:
            return self.height, self.width
        short, long = sorted((height, width))
        exact = float(self.shortest)
        shorter = self.shortest
        if long / short * exact > self.longest:
            exact = self.longest * short / long
            shorter = round(exact)
        longer = long if short == shorter else int(exact * long / short)
        shorter, longer = (side // self.multiple * self.multiple for side in (shorter, longer))
        return (shorter, longer) if height <= width else (longer, shorter)


def normalized(images: Tensor, mean: Sequence[float], std: Sequence[float]) -> Tensor:
    """Images (B, 3, H, W) less ``mean`` and over ``std`` of their channels."""
    less, over = (torch.tensor(one, device=images.device, dtype=images.dtype)[:, None, None] for one in (mean, std))
    return (images - less) / over


def read_scaling(path: Path, default: Scaling) -> Scaling:
    """The scaling of a ``preprocessor_config.json``; ``default`` where there is no such file or it leaves things out.

    Raises:
        RaucaError: unreadable file, or a kind of resizing that is not known here.
    """
    if not path.is_file():
        return default
    options = read_json(path)
    scaling = default
    size = options.get("size")
    if isinstance(size, int):
        size = {"shortest_edge": size, "longest_edge": options.get("max_size", 1333)}
    try:
        if isinstance(size, dict) and "shortest_edge" in size:
            scaling = replace(
                scaling, shortest=int(size["shortest_edge"]), longest=int(size["longest_edge"]), height=0, width=0
            )
        elif isinstance(size, dict):
            scaling = replace(scaling, shortest=0, longest=0, height=int(size["height"]), width=int(size["width"]))
        mean, std = (tuple(map(float, options.get(f"image_{key}", ()))) for key in ("mean", "std"))
        mode = _MODES[options.get("resample", 2)]
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise RaucaError(f"{path}: describes a resizing that is not known here ({error!r})") from error
    if options.get("do_resize") is False:
        raise RaucaError(f"{path}: do_resize is false; detectors here take images of any size, so give a size")
    if options.get("do_normalize") is False:
        mean, std = AS_THEY_ARE
    return replace(scaling, mean=mean or scaling.mean, std=std or scaling.std, mode=mode)


def read_json(path: Path) -> dict[str, Any]:
    """The object in a JSON file; raises :class:`RaucaError` for anything else."""
    found = parse_json(read_text(path, MAX_CONFIG_BYTES, "a configuration"), str(path))
    if not isinstance(found, dict):
        raise RaucaError(f"{path}: expected a JSON object")
    return found
