"""Images to detect in: a data set's frames, or pictures drawn for lack of them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from rauca_core.contract import Dataset, RaucaError
from rauca_core.runtime.images import read_image

USUAL = Path("runs") / "demo" / "held-out"  # the demo's frames, when it has been run here


def choose_images(dataset: Path | None, count: int) -> tuple[str, list[Tensor]]:
    """``count`` images (1, 3, H, W) sRGB and where they come from: evenly spread frames, or drawn ones.

    Raises:
        RaucaError: a data set was asked for that cannot be read or has no frames.
    """
    folder = dataset or (USUAL if (USUAL / "dataset.json").is_file() else None)
    if folder is None:
        return "drawn", [tensor_of(draw_street(seed)) for seed in range(count)]
    opened = Dataset(folder)
    frames = opened.frames()
    if not frames:
        raise RaucaError(f"{folder}: holds no frames")
    chosen = [frames[index * len(frames) // count] for index in range(count)]
    return folder.name, [_frame(opened, frame.id) for frame in chosen]


def squared(image: Tensor, size: int) -> Tensor:
    """Stretched to the network's square, so that adapter and reference get the same pixels."""
    return functional.interpolate(image, size=(size, size), mode="bilinear", antialias=True).clamp(0, 1)


def _frame(dataset: Dataset, frame_id: str) -> Tensor:
    return tensor_of(read_image(dataset.frame_folder(frame_id) / "image.png").astype(np.float32) / 255)


def tensor_of(image_srgb: NDArray[np.float32]) -> Tensor:
    return torch.from_numpy(np.ascontiguousarray(image_srgb.transpose(2, 0, 1)[None]))


def draw_street(seed: int) -> NDArray[np.float32]:
    """A sky, a road and boxes on wheels, with noise: (320, 416, 3) sRGB. Nothing but variety is asked of it."""
    rng = np.random.default_rng(seed)
    canvas = np.empty((320, 416, 3), np.float32)
    horizon = int(rng.integers(120, 180))
    canvas[:horizon] = np.linspace(0.9, 0.6, horizon)[:, None, None] * np.array([0.8, 0.9, 1.0])
    canvas[horizon:] = np.linspace(0.45, 0.25, 320 - horizon)[:, None, None]
    for _ in range(int(rng.integers(2, 5))):
        width = int(rng.integers(40, 160))
        left, foot = int(rng.integers(0, 416 - width)), int(rng.integers(horizon + 20, 310))
        color, height = rng.uniform(0.05, 0.95, 3).tolist(), width // 3
        cv2.rectangle(canvas, (left, foot - height), (left + width, foot), color, -1)
        cv2.rectangle(canvas, (left + width // 5, foot - 2 * height), (left + 4 * width // 5, foot - height), color, -1)
        for wheel in (left + width // 5, left + 4 * width // 5):
            cv2.circle(canvas, (wheel, foot), width // 9, (0.05, 0.05, 0.05), -1)
    canvas += rng.normal(0, 0.03, canvas.shape)
    return canvas.clip(0, 1)
