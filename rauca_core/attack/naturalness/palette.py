"""Few colours: a colour is free while it moves, and seen as the nearest of the palette.

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
from ...images import read_image
from ..background import cluster
from .choice import is_colour, parse_colour

PIXELS = 16_384  # of a photograph, looked at for its colours
MOST = 64
MAX_TEXT_BYTES = 2**16  # 64 colours and room for spaces


def read_palette(given: str, colours: int, seed: int = 0) -> tuple[str, ...]:
    """The colours ``#rrggbb`` that a user means.

    Args:
        given: colours, comma separated; or a text file of them, one a line or comma separated; or an image.
        colours: how many to find in an image, by k-means, darkest first; fewer where the image has fewer.

    Raises:
        RaucaError: no colour, not a colour, too many, or an unreadable file.
    """
    if is_colour(given):
        found = given.split(",")
    elif Path(given).suffix.lower() in (".txt", ".csv", ".hex"):
        found = _read_text(Path(given))
    else:
        found = colours_of_image(Path(given), colours, seed)
    found = [colour.strip().lower() for colour in found if colour.strip()]
    for colour in found:
        parse_colour(colour, "--palette")
    if not 1 <= len(found) <= MOST:
        raise RaucaError(f"--palette {given}: {len(found)} colours; give 1 to {MOST}")
    return tuple(dict.fromkeys(found))


def colours_of_image(path: Path, count: int, seed: int = 0) -> list[str]:
    """The ``count`` colours ``#rrggbb`` of an image that k-means finds, darkest first."""
    if not 1 <= count <= MOST:
        raise RaucaError(f"--palette-colours {count}: choose 1 to {MOST}")
    image = read_image(path)
    pixels = (np.repeat(image[..., None], 3, -1) if image.ndim == 2 else image).reshape(-1, 3)
    rng = named_rng(seed, "palette")
    centres = cluster(pixels[rng.integers(0, len(pixels), PIXELS)] / 255.0, count, rng)
    return [
        "#{:02x}{:02x}{:02x}".format(*row) for row in np.rint(centres[np.argsort(centres.sum(1))] * 255).astype(int)
    ]


def _read_text(path: Path) -> list[str]:
    try:
        return read_text(path, MAX_TEXT_BYTES, "a list of colours").replace("\n", ",").split(",")
    except RaucaError as error:
        told = str(error).removeprefix(f"{path}: ")
        raise RaucaError(f"--palette {path}: not readable ({told}); give colours, a text file or an image") from None


class Palette:
    """Colours to choose from.

    Attributes:
        colours: (K, 3) sRGB in [0, 1].
        warmth: of the soft choice: the squared distance between neighbouring colours of the palette, their mean.
    """

    def __init__(self, colours: tuple[str, ...], dtype: torch.dtype = torch.float32) -> None:
        bytes_ = np.array([parse_colour(colour, "--palette") for colour in colours])
        self.colours = torch.from_numpy(bytes_ / 255.0).to(dtype)
        apart = torch.cdist(self.colours, self.colours).square()
        apart.fill_diagonal_(torch.inf)
        self.warmth = float(apart.amin(1).mean()) if len(colours) > 1 else 1.0

    def nearest(self, free: Tensor, allowed: Tensor | None = None) -> Tensor:
        """Which palette colour each free colour (N, 3) is seen as, of those ``allowed`` (N, K): (N,)."""
        return _distances(free, self.colours.to(free), allowed).argmin(1)

    def soft(self, free: Tensor, allowed: Tensor | None = None) -> Tensor:
        """The mean of the palette weighted by nearness, (N, 3)."""
        colours = self.colours.to(free)
        return _shares(free, colours, self.warmth, allowed) @ colours

    def hard(self, free: Tensor, allowed: Tensor | None = None) -> Tensor:
        """The nearest colours (N, 3); their gradient is that of :meth:`soft`."""
        seen: Tensor = _Hard.apply(free, self.colours.to(free), self.warmth, allowed)
        return seen


def _distances(free: Tensor, colours: Tensor, allowed: Tensor | None) -> Tensor:
    # |c - p|^2 without |c|^2, which no comparison needs: one product in place of K differences.
    distance = colours.square().sum(1) - 2 * free @ colours.T
    return distance if allowed is None else distance.masked_fill(~allowed, torch.inf)


def _shares(free: Tensor, colours: Tensor, warmth: float, allowed: Tensor | None) -> Tensor:
    return torch.softmax(_distances(free, colours, allowed) / -warmth, 1)


class _Hard(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, free: Tensor, colours: Tensor, warmth: float, allowed: Tensor | None) -> Tensor:
        ctx.warmth, ctx.allowed = warmth, allowed
        ctx.save_for_backward(free, colours)
        return colours[_distances(free, colours, allowed).argmin(1)]

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None, None]:
        """The soft map's slope is 2 / warmth times the palette's covariance under the shares."""
        free, colours = ctx.saved_tensors
        share = _shares(free, colours, ctx.warmth, ctx.allowed)
        asked = gradients[0] @ colours.T
        mean = (share * asked).sum(1, keepdim=True)
        return (2 / ctx.warmth) * ((share * (asked - mean)) @ colours), None, None, None


def palette_bytes(colours: tuple[str, ...]) -> NDArray[np.uint8]:
    """(K, 3) 8-bit sRGB."""
    return np.array([parse_colour(colour, "--palette") for colour in colours], np.uint8)
