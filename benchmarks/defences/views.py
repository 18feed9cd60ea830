"""The views of a run: held-out frames in their own paint and in the camouflage, both rendered by Cycles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from rauca_core.contract import Dataset, Frame, RaucaError
from rauca_core.study.images_of import read_frame_image


@dataclass(frozen=True, eq=False)
class Views:
    """Images (B, 3, H, W) sRGB by paint, and the vehicle's boxes (B, 4) xyxy, pixels."""

    frames: tuple[str, ...]
    boxes: Tensor
    paints: dict[str, Tensor]

    def part(self, chosen: Sequence[int]) -> Views:
        """Some of the frames."""
        index = list(chosen)
        paints = {name: images[index] for name, images in self.paints.items()}
        return Views(tuple(self.frames[i] for i in index), self.boxes[index], paints)

    def with_paint(self, name: str, images: Tensor) -> Views:
        """The same views in one more paint."""
        return Views(self.frames, self.boxes, {**self.paints, name: images})


def read_views(run: Path) -> Views:
    """The held-out frames of a folder laid out as the demo's that show the vehicle.

    Raises:
        RaucaError: there are none, or an image is missing.
    """
    dataset = Dataset(run / "held-out")
    frames = [frame for frame in dataset.frames() if frame.box_xyxy is not None]
    if len(frames) < 2:
        raise RaucaError(f"{run}: fewer than two held-out frames show the vehicle; run `rauca demo` first")
    paints = {
        "normal": _read([(dataset.frame_folder(frame.id) / "image.png", frame) for frame in frames]),
        "camouflage": _read([(run / "renders" / "rauca" / f"{frame.id}.png", frame) for frame in frames]),
    }
    boxes = torch.tensor([frame.box_xyxy for frame in frames], dtype=torch.float32)
    return Views(tuple(frame.id for frame in frames), boxes, paints)


def _read(paths: Sequence[tuple[Path, Frame]]) -> Tensor:
    pixels = np.stack([read_frame_image(path, frame) for path, frame in paths])
    return torch.from_numpy(pixels).permute(0, 3, 1, 2).float() / 255
