"""A finished frame's images, read once and handed around."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, Frame, load_passes
from ..runtime.images import read_image

GREY = ("vehicle.png", "paint.png", "semantic.png", "instances.png")


@dataclass(frozen=True, eq=False)
class StoredFrame:
    """One frame of a data set; images are read when asked for.

    Attributes:
        folder: of the frame.
        frame: its ``frame.json``.
    """

    folder: Path
    frame: Frame

    @staticmethod
    def all_of(dataset: Dataset) -> list[StoredFrame]:
        """The finished frames, in plan order."""
        return [StoredFrame(dataset.frame_folder(frame.id), frame) for frame in dataset.frames()]

    def image(self, name: str = "image.png") -> NDArray[np.uint8]:
        """A PNG of the frame: (H, W) for coverage and ids, (H, W, 3) sRGB for pictures."""
        return read_image(self.folder / name)

    def vehicle_mask(self) -> NDArray[np.bool_]:
        """(H, W) pixels at least half covered by the vehicle; the frame's box is theirs."""
        return self.image("vehicle.png") >= 128

    def instance_mask(self, number: int) -> NDArray[np.bool_]:
        """(H, W) pixels that show another vehicle."""
        return self.image("instances.png") == number

    def maps(self, *names: str) -> dict[str, NDArray[Any]]:
        """Arrays of ``passes.npz``."""
        return load_passes(self.folder, names)
