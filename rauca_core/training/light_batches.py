"""Frames put together for a step of training, and the same frames seen anew: other paint, other light, mirrored."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..environment.frames import LightFrame
from ..render import linear_to_srgb

EXPOSURES = (0.5, 2.0)  # factor on the light of a whole frame
TINT = 0.2  # largest change of that factor from channel to channel, in logarithms
TRANSMITTANCES = (0.2, 0.9)  # of a veil
GLOWS = (0.3, 1.5)  # of a veil that lets nothing through, times the frame's mean light
IMAGES = ("image", "paint", "vehicle", "A", "B")
DARKEST_REFERENCE = 0.04  # sRGB 0.22; a darker reference paint tells nothing about the light on it


@dataclass(frozen=True, eq=False)
class Shown:
    """A frame, or a batch of frames of one size (B, ...), as float32 tensors.

    Attributes:
        image: (3, H, W) sRGB.
        paint, vehicle: (1, H, W) coverage in [0, 1].
        A, B: (3, H, W) linear.
        reference: (3,) linear albedo.
    """

    image: Tensor
    paint: Tensor
    vehicle: Tensor
    A: Tensor
    B: Tensor
    reference: Tensor

    def on_images(self, change: Callable[[Tensor], Tensor]) -> Shown:
        """With all images changed alike."""
        return replace(self, **{name: change(getattr(self, name)) for name in IMAGES})

    def to(self, device: torch.device) -> Shown:
        return Shown(**{name: value.to(device) for name, value in vars(self).items()})


def shown(frame: LightFrame) -> Shown:
    """A frame as it is."""
    image, paint, vehicle = (x.float() / 255 for x in (frame.image, frame.paint, frame.vehicle))
    return Shown(image, paint, vehicle, frame.A.float(), frame.B.float(), frame.reference)


def collate(frames: Sequence[Shown]) -> Shown:
    """Stack frames of one size."""
    return Shown(**{name: torch.stack([vars(frame)[name] for frame in frames]) for name in vars(frames[0])})


def augment(frame: Shown, rng: np.random.Generator, share: float = 0.5) -> Shown:
    """A frame as it would look in other light and other reference paint; exact, since light is linear.

    Half of all frames are mirrored, a ``share`` gets its light tinted and scaled by a factor from `EXPOSURES`, a
    ``share`` another reference paint, and half a ``share`` is seen through a veil: haze that is even over the frame
    dims everything and adds its own glow, which is all B's. The image is then displayed and rounded to 8 bits again.
    """
    low, high = np.log(EXPOSURES)
    brighter = np.exp(rng.uniform(low, high) + rng.uniform(-TINT, TINT, 3))
    brightened, paint = rng.random() < share, rng.uniform(DARKEST_REFERENCE, 1.0, 3)
    paint = paint if rng.random() < 0.5 else paint[:1].repeat(3)  # half of them grey, as cars are
    repainted, mirrored = rng.random() < share, rng.random() < 0.5
    veiled, through = rng.random() < share / 2, rng.uniform(*TRANSMITTANCES)
    glow = rng.uniform(*GLOWS) * np.exp(rng.uniform(-TINT, TINT, 3)) * (1 - through)
    A, B, reference = frame.A, frame.B, frame.reference
    if veiled:
        mean = (A * reference[:, None, None] + B).mean()
        A, B = A * through, B * through + _wide(glow) * mean
    if brightened:
        A, B = A * _wide(brighter), B * _wide(brighter)
    if repainted:
        reference = torch.from_numpy(paint).float()
    if veiled or brightened or repainted:
        image = (linear_to_srgb(A * reference[:, None, None] + B) * 255).round() / 255
        frame = replace(frame, image=image, A=A, B=B, reference=reference)
    return frame.on_images(lambda image: image.flip(-1)) if mirrored else frame


def _wide(values: NDArray[np.float64]) -> Tensor:
    return torch.from_numpy(values).float()[:, None, None]


def crop(frame: Shown, side: int, rng: np.random.Generator) -> Shown:
    """A random square of ``side`` pixels about some of the frame's paint, if there is any."""
    height, width = frame.image.shape[-2:]
    if side >= min(height, width):
        return frame
    rows, columns = torch.nonzero(frame.paint[0], as_tuple=True)
    center = (height / 2, width / 2)
    if len(rows):
        pick = int(rng.integers(len(rows)))
        center = float(rows[pick]), float(columns[pick])
    corner = [c - side / 2 + rng.uniform(-0.25, 0.25) * side for c in center]
    row, column = (int(np.clip(c, 0, n - side)) for c, n in zip(corner, (height, width), strict=True))
    return frame.on_images(lambda image: image[..., row : row + side, column : column + side])


def draw_albedos(rng: np.random.Generator, count: int, height: int, width: int) -> Tensor:
    """Linear albedos (count, 3, H, W) to compare light in: half solid colors, half a color per pixel.

    sRGB values are uniform, a third of the solid ones corners of the cube, where light shows most.
    """
    solid = rng.random((count, 3, 1, 1), dtype=np.float32)
    corners = rng.random((count, 1, 1, 1)) < 1 / 3
    solid = np.where(corners, solid.round(), solid)
    drawn = torch.from_numpy(solid).expand(-1, -1, height, width).clone()
    for k in range(count // 2):
        drawn[k] = torch.from_numpy(rng.random((3, height, width), dtype=np.float32))
    return drawn.pow(2.2)  # near enough to the sRGB curve for a draw
