"""What a run looks like while it runs: two pictures in its folder that any viewer can watch."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..contract.color import to_bytes
from ..contract.files import png_bytes, write_bytes

SIDE = 512  # pixels, at most for the UV map
SHARE = 0.02  # of the run's time that pictures may take: it is waited so much longer than the last ones took
PICTURE, UV_MAP = "preview.png", "preview-uv-map.png"


class Preview:
    """Replaces ``preview.png`` (the UV map, and a frame in the paint beside it) and ``preview-uv-map.png``.

    Both are replaced whole: a reader never meets half a picture.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._next_s = folder, 0.0

    @property
    def due(self) -> bool:
        """Whether the pictures may be renewed without slowing the run."""
        return time.monotonic() >= self._next_s

    def show(self, uv_map_srgb: Tensor, image_srgb: Tensor) -> None:
        """Show a UV map (3, size, size) and a rendered frame (3, H, W)."""
        begin = time.monotonic()
        small = shrunk(uv_map_srgb, SIDE)
        frame = functional.interpolate(image_srgb[None].float().cpu(), size=small.shape[1:], mode="bilinear")[0]
        write_bytes(self._folder / UV_MAP, png_bytes(_pixels(small)))
        write_bytes(self._folder / PICTURE, png_bytes(_pixels(torch.cat([small, frame], 2))))
        end = time.monotonic()
        self._next_s = end + (end - begin) * (1 / SHARE - 1)


def shrunk(uv_map_srgb: Tensor, side: int) -> Tensor:
    """A UV map (3, size, size) of ``side`` texels at most, by the mean of its sRGB values: to look at only."""
    return functional.adaptive_avg_pool2d(uv_map_srgb.cpu(), min(side, uv_map_srgb.shape[-1])).clamp(0, 1)


def _pixels(image: Tensor) -> NDArray[np.uint8]:
    return to_bytes(image.clamp(0, 1).permute(1, 2, 0).numpy())
