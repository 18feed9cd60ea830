"""Frames put together for a step of training, and the same frames seen anew: other paint, other light, mirrored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from ..environment.frames import LightFrame
from ..render import linear_to_srgb

EXPOSURES = (0.5, 2.0)  # factor on the light of a whole frame
TINT = 0.2  # largest change of that factor from channel to channel, in logarithms
TRANSMITTANCES = (0.2, 0.9)  # of a veil
GLOWS = (0.3, 1.5)  # of a veil that lets nothing through, times the frame's mean light
DARKEST_REFERENCE = 0.04  # sRGB 0.22; a darker reference paint tells nothing about the light on it


@dataclass(frozen=True, eq=False)
class Batch:
    """Frames as float32 tensors.

    Attributes:
        names: the frames' folders.
        image: (B, 3, H, W) sRGB.
        paint, vehicle: (B, 1, H, W) coverage in [0, 1].
        A, B: (B, 3, H, W) linear.
        reference: (B, 3) linear albedo.
    """

    names: tuple[str, ...]
    image: Tensor
    paint: Tensor
    vehicle: Tensor
    A: Tensor
    B: Tensor
    reference: Tensor

    def to(self, device: torch.device) -> Batch:
        return self._changed({k: v.to(device) for k, v in vars(self).items() if isinstance(v, Tensor)})

    def mirrored(self, which: Tensor) -> Batch:
        """Left and right exchanged in the frames of ``which`` (B,)."""
        images = {k: v for k, v in vars(self).items() if isinstance(v, Tensor) and v.ndim == 4}
        return self._changed({k: torch.where(_wide(which), v.flip(-1), v) for k, v in images.items()})

    def _changed(self, tensors: dict[str, Tensor]) -> Batch:
        return Batch(**{**vars(self), **tensors})

    def window(self, row: int, column: int, side: int) -> Batch:
        """A square of the images."""
        cut = (..., slice(row, row + side), slice(column, column + side))
        images = {k: getattr(self, k)[cut] for k in ("image", "paint", "vehicle", "A", "B")}
        return self._changed(images)


def collate(frames: Sequence[LightFrame]) -> Batch:
    """Stack frames of one size."""

    def stack(name: str, scale: float = 1.0) -> Tensor:
        return torch.stack([getattr(f, name).float() for f in frames]) / scale  # autocast stacks no float16

    images = {"image": stack("image", 255), "paint": stack("paint", 255), "vehicle": stack("vehicle", 255)}
    return Batch(
        tuple(f.name for f in frames), **images, A=stack("A"), B=stack("B"), reference=stack("reference")
    )  # fmt: skip


def join(batches: Sequence[Batch]) -> Batch:
    """One batch of several, of images of one size."""
    names = tuple(name for batch in batches for name in batch.names)
    tensors = {k: torch.cat([getattr(b, k) for b in batches]) for k in vars(batches[0]) if k != "names"}
    return Batch(names, **tensors)


def augment(batch: Batch, rng: np.random.Generator, share: float = 0.5) -> Batch:
    """Frames as they would look in other light and other reference paint; exact, since light is linear.

    Half of all frames are mirrored, a ``share`` gets its light tinted and scaled by a factor from `EXPOSURES`, a
    ``share`` another reference paint, and half a ``share`` is seen through a veil. The image is then displayed and
    rounded to 8 bits again.
    """
    count = len(batch.names)
    low, high = np.log(EXPOSURES)
    brighter = np.exp(rng.uniform(low, high, (count, 1)) + rng.uniform(-TINT, TINT, (count, 3)))
    exposure = np.where(rng.random((count, 1)) < share, brighter, 1.0)
    paint = rng.uniform(DARKEST_REFERENCE, 1.0, (count, 3))
    paint = np.where(rng.random((count, 1)) < 0.5, paint, paint[:, :1])  # half of them grey, as cars are
    repainted = torch.from_numpy(rng.random(count) < share)
    mirrored = torch.from_numpy(rng.random(count) < 0.5)
    factor = torch.from_numpy(exposure).float()
    batch, veiled = _veil(batch, rng, share / 2)
    reference = torch.where(repainted[:, None], torch.from_numpy(paint).float(), batch.reference)
    A, B = (light * factor[:, :, None, None] for light in (batch.A, batch.B))
    image = (linear_to_srgb(A * reference[:, :, None, None] + B) * 255).round() / 255
    changed = _wide(repainted | veiled | (factor != 1).any(dim=1))
    seen = replace(batch, image=torch.where(changed, image, batch.image), A=A, B=B, reference=reference)
    return seen.mirrored(mirrored)


def _veil(batch: Batch, rng: np.random.Generator, share: float) -> tuple[Batch, Tensor]:
    """Frames behind haze that is even over the frame: it dims everything and adds its own glow, which is all B's.

    Returns:
        The batch, and which frames (B,) are behind a veil.
    """
    count = len(batch.names)
    veiled = rng.random(count) < share
    through = np.where(veiled, rng.uniform(*TRANSMITTANCES, count), 1.0)[:, None]
    level = rng.uniform(*GLOWS, (count, 1)) * np.exp(rng.uniform(-TINT, TINT, (count, 3))) * (1 - through)
    mean = (batch.A * batch.reference[:, :, None, None] + batch.B).mean(dim=(1, 2, 3))
    dimming = torch.from_numpy(through).float()[:, :, None, None]
    glow = torch.from_numpy(level).float()[:, :, None, None] * _wide(mean)
    return replace(batch, A=batch.A * dimming, B=batch.B * dimming + glow), torch.from_numpy(veiled)


def crop(batch: Batch, side: int, rng: np.random.Generator) -> Batch:
    """A random square of ``side`` pixels, the same for all frames, about some frame's paint if there is any."""
    height, width = batch.image.shape[-2:]
    if side >= min(height, width):
        return batch
    rows, columns = torch.nonzero(batch.paint[int(rng.integers(len(batch.names))), 0], as_tuple=True)
    center = (height / 2, width / 2)
    if len(rows):
        pick = int(rng.integers(len(rows)))
        center = float(rows[pick]), float(columns[pick])
    corner = [c - side / 2 + rng.uniform(-0.25, 0.25) * side for c in center]
    row, column = (int(np.clip(c, 0, n - side)) for c, n in zip(corner, (height, width), strict=True))
    return batch.window(row, column, side)


def draw_albedos(rng: np.random.Generator, count: int, batch: int, height: int, width: int) -> Tensor:
    """Linear albedos (count, batch, 3, H, W) to compare light in: half solid colors, half a color per pixel.

    sRGB values are uniform, a third of the solid ones corners of the cube, where light shows most.
    """
    solid = rng.random((count, batch, 3, 1, 1), dtype=np.float32)
    corners = rng.random((count, batch, 1, 1, 1)) < 1 / 3
    solid = np.where(corners, solid.round(), solid)
    drawn = torch.from_numpy(solid).expand(-1, -1, -1, height, width).clone()
    for k in range(count // 2):
        drawn[k] = torch.from_numpy(rng.random((batch, 3, height, width), dtype=np.float32))
    return drawn.pow(2.2)  # near enough to the sRGB curve for a draw


def _wide(values: Tensor) -> Tensor:
    return values[:, None, None, None]
