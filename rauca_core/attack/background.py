"""The dominant colors around the vehicle, which ACTIVE draws its camouflage towards."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset
from ..contract.seeding import named_rng
from ..runtime.images import read_image
from .frames import FrameStore

FRAMES, PIXELS, ROUNDS = 64, 512, 30  # looked at, of each, of k-means


def background_colors(dataset: Dataset, store: FrameStore, count: int, seed: int) -> NDArray[np.float32]:
    """The ``count`` dominant colors (count, 3) sRGB of what is not vehicle, darkest first.

    Frames and pixels are drawn by name of the seed: a resumed run, or another process, finds the same.

    Raises:
        RaucaError: a frame's picture is missing or damaged.
    """
    rng, found = named_rng(seed, "background"), []
    for index in rng.permutation(len(store))[:FRAMES]:
        folder = dataset.frame_folder(store.frames[int(index)].id)
        image, vehicle = read_image(folder / "image.png"), read_image(folder / "vehicle.png")
        around = image.reshape(-1, 3)[vehicle.reshape(len(image) * image.shape[1], -1)[:, 0] == 0]
        if len(around):
            found.append(around[rng.integers(0, len(around), PIXELS)])
    pixels = np.concatenate(found) if found else np.full((1, 3), 128)
    centers = cluster(pixels / 255.0, count, rng)
    return np.asarray(centers[np.argsort(centers.sum(1))], np.float32)


def cluster(points: NDArray[np.floating], count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """k-means: ``count`` centers (count, 3) of points (N, 3), begun far apart (k-means++)."""
    centers = points[rng.integers(len(points))][None].astype(np.float64)
    for _ in range(count - 1):
        distance = _squares(points, centers).min(1)
        total = distance.sum()
        chance = distance / total if total > 0 else None  # fewer colors than centers: any will do
        centers = np.concatenate([centers, points[rng.choice(len(points), p=chance)][None]])
    for _ in range(ROUNDS):
        nearest = _squares(points, centers).argmin(1)
        sizes = np.bincount(nearest, minlength=count)
        sums = np.stack([np.bincount(nearest, column, count) for column in points.T], 1)
        centers = np.where(sizes[:, None] > 0, sums / np.maximum(sizes, 1)[:, None], centers)
    return centers


def _squares(points: NDArray[np.floating], centers: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.asarray(((points[:, None] - centers[None]) ** 2).sum(-1))
