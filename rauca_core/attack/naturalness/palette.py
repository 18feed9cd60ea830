"""Few colors: a color is free while it moves, and seen as the nearest of the palette.

Every step looks at the hard map (straight-through): its loss is the finished camouflage's loss, nothing is left to
harden. The way back goes through the soft map, a mean of the palette weighted by nearness, whose slope exists.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...contract import RaucaError
from ...contract.reading import read_text
from ...contract.seeding import named_rng
from ...runtime.images import read_image
from . import is_color, parse_color

PIXELS = 16_384  # of a photograph, looked at for its colors
MOST = 64
ROUNDS = 30  # of k-means
MAX_TEXT_BYTES = 2**16  # 64 colors and room for spaces


def read_palette(given: str, colors: int) -> tuple[str, ...]:
    """The colors ``#rrggbb`` that a user means.

    Args:
        given: colors, comma separated; or a text file of them, one a line or comma separated; or an image.
        colors: how many to find in an image, by k-means, darkest first; fewer where the image has fewer.

    Raises:
        RaucaError: no color, not a color, too many, or an unreadable file.
    """
    if is_color(given):
        found = given.split(",")
    elif Path(given).suffix.lower() in (".txt", ".csv", ".hex"):
        try:
            found = read_text(Path(given), MAX_TEXT_BYTES, "a list of colors").replace("\n", ",").split(",")
        except RaucaError as error:
            told = str(error).removeprefix(f"{Path(given)}: ")
            raise RaucaError(
                f"--palette {given}: not readable ({told}); give colors, a text file or an image"
            ) from None
    else:
        found = colors_of_image(Path(given), colors)
    found = [color.strip().lower() for color in found if color.strip()]
    for color in found:
        parse_color(color, "--palette")
    if not 1 <= len(found) <= MOST:
        raise RaucaError(f"--palette {given}: {len(found)} colors; give 1 to {MOST}")
    return tuple(dict.fromkeys(found))


def colors_of_image(path: Path, count: int) -> list[str]:
    """The ``count`` colors ``#rrggbb`` of an image that k-means finds, darkest first."""
    if not 1 <= count <= MOST:
        raise RaucaError(f"--palette-colors {count}: choose 1 to {MOST}")
    image = read_image(path)
    pixels = (np.repeat(image[..., None], 3, -1) if image.ndim == 2 else image).reshape(-1, 3)
    rng = named_rng(0, "palette")
    centers = cluster(pixels[rng.integers(0, len(pixels), PIXELS)] / 255.0, count, rng)
    return ["#{:02x}{:02x}{:02x}".format(*row) for row in np.rint(centers * 255).astype(int)]


def cluster(points: NDArray[np.floating], count: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """k-means: ``count`` centers (count, 3) of colors (N, 3), darkest first; begun far apart (k-means++)."""
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
    return centers[np.argsort(centers.sum(1))]


def _squares(points: NDArray[np.floating], centers: NDArray[np.floating]) -> NDArray[np.float64]:
    return np.asarray(((points[:, None] - centers[None]) ** 2).sum(-1))


class Palette:
    """Colors to choose from.

    Attributes:
        colors: (K, 3) sRGB in [0, 1].
        warmth: of the soft choice: the squared distance between neighboring colors of the palette, their mean.
    """

    def __init__(self, colors: tuple[str, ...]) -> None:
        self.colors = torch.from_numpy(palette_bytes(colors) / 255.0).float()
        apart = torch.cdist(self.colors, self.colors).square()
        apart.fill_diagonal_(torch.inf)
        self.warmth = float(apart.amin(1).mean()) if len(colors) > 1 else 1.0

    def hard(self, free: Tensor, allowed: Tensor | None = None) -> Tensor:
        """The nearest colors (N, 3) of those ``allowed`` (N, K); the gradient is that of the soft choice."""
        seen: Tensor = _Hard.apply(free, self.colors.to(free), self.warmth, allowed)
        return seen


def _distances(free: Tensor, colors: Tensor, allowed: Tensor | None) -> Tensor:
    # |c - p|^2 without |c|^2, which no comparison needs: one product in place of K differences.
    distance = colors.square().sum(1) - 2 * free @ colors.T
    return distance if allowed is None else distance.masked_fill(~allowed, torch.inf)


class _Hard(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, free: Tensor, colors: Tensor, warmth: float, allowed: Tensor | None) -> Tensor:
        ctx.warmth, ctx.allowed = warmth, allowed
        ctx.save_for_backward(free, colors)
        return colors[_distances(free, colors, allowed).argmin(1)]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        """The soft map's slope is 2 / warmth times the palette's covariance under the shares."""
        free, colors = ctx.saved_tensors
        share = torch.softmax(_distances(free, colors, ctx.allowed) / -ctx.warmth, 1)
        asked = gradients[0] @ colors.T
        mean = (share * asked).sum(1, keepdim=True)
        return (2 / ctx.warmth) * ((share * (asked - mean)) @ colors), None, None, None


def palette_bytes(colors: tuple[str, ...]) -> NDArray[np.uint8]:
    """(K, 3) 8-bit sRGB."""
    return np.array([parse_color(color, "--palette") for color in colors], np.uint8)
