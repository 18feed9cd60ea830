"""Random output augmentation (ROA): the rendered image is moved, scaled and relit before the detector sees it.

Unlike in the public code, the ground-truth box moves with the image; ``published`` is that code's: there it stays.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ..render import saturate
from . import augmentation_cpu

BACKDROP = 0.5  # sRGB grey where the moved image leaves the frame empty, like a letterbox's border


AugmentationName = Literal["rauca", "active", "zoomed", "published"]
FILL = 1.2  # of a side of the picture that a vehicle drawn nearer fills at most


@dataclass(frozen=True)
class Ranges:
    """What is drawn from, uniformly.

    Attributes:
        rotation_deg: either way.
        translation: either way, of the image's side.
        scales: lowest and highest.
        brightness: either way, added, in sRGB units.
        contrasts: lowest and highest, about the image's own mean.
        jitter: probability of a change of color.
        mirror: probability that left and right change places: as good a view, which costs no render.
        move: probability of being turned, shifted and scaled.
        zoom: scales are even in their logarithm, the highest is of pixels of the frame as they are shown, and a vehicle
            drawn nearer stays in the picture, see `Augmentation.zoomed`.
        as_published: black where the image leaves the frame empty; contrast multiplies, about black, and comes before
            or after brightness, each clipped to [0, 1]; the box stays.
    """

    rotation_deg: float = 5.0
    translation: float = 0.1
    scales: tuple[float, float] = (0.7, 1.0)
    brightness: float = 0.25
    contrasts: tuple[float, float] = (0.75, 1.5)
    jitter: float = 0.5
    mirror: float = 0.0
    move: float = 1.0
    zoom: bool = False
    as_published: bool = False


RANGES: dict[AugmentationName, Ranges] = {
    "rauca": Ranges(),
    "active": Ranges(rotation_deg=0.0, scales=(0.25, 1.0), jitter=1.0),
    "zoomed": Ranges(scales=(0.6, 1.2), mirror=0.5, zoom=True),
    # kornia's RandomAffine moves every second image where it is not told otherwise, and the public code does not.
    "published": Ranges(move=0.5, as_published=True),
}


@dataclass(frozen=True)
class Augmentation:
    """One drawn augmentation per image of a batch.

    Attributes:
        matrix: (B, 2, 3) source to target in centered pixels: ``target = matrix @ (x - W/2, y - H/2, 1)``, in units of
            the image's side for the translation.
        brightness: (B,) offset; 0 leaves the image alone.
        contrast: (B,) factor; 1 leaves the image alone.
        brightness_first: (B,) bool, only as published: whether brightness comes before contrast.
        chances: (B, 3) in [0, 1], only with ``zoom``: where in its range scale, right and down lie.
    """

    matrix: Tensor
    brightness: Tensor
    contrast: Tensor
    brightness_first: Tensor | None = None
    chances: Tensor | None = None

    @staticmethod
    def draw(rng: np.random.Generator, batch: int, ranges: Ranges = RANGES["rauca"]) -> Augmentation:
        """Draw from a named generator, see ``contract.seeding``."""
        angle = np.radians(rng.uniform(-ranges.rotation_deg, ranges.rotation_deg, batch))
        scale = rng.uniform(*ranges.scales, batch)
        shift = rng.uniform(-ranges.translation, ranges.translation, (batch, 2))
        jitter = rng.random(batch) < ranges.jitter
        brightness = np.where(jitter, rng.uniform(-ranges.brightness, ranges.brightness, batch), 0.0)
        contrast = np.where(jitter, rng.uniform(*ranges.contrasts, batch), 1.0)
        # Drawn only where asked for: other ranges keep the random stream that they had.
        side = np.where(rng.random(batch) < ranges.mirror, -1.0, 1.0) if ranges.mirror else np.ones(batch)
        if ranges.move < 1:
            still = rng.random(batch) >= ranges.move
            angle, scale, shift = np.where(still, 0.0, angle), np.where(still, 1.0, scale), shift * ~still[:, None]
        cosine, sine = scale * np.cos(angle), scale * np.sin(angle)
        rows = [np.stack([side * cosine, -sine, shift[:, 0]], 1), np.stack([side * sine, cosine, shift[:, 1]], 1)]
        matrix, added, factor = (
            torch.tensor(values, dtype=torch.float32) for values in (np.stack(rows, 1), brightness, contrast)
        )
        first = torch.tensor(rng.random(batch) < 0.5) if ranges.as_published else None
        chances = torch.from_numpy(rng.random((batch, 3))) if ranges.zoom else None
        return Augmentation(matrix, added, factor, first, chances)

    def part(self, first: int, step: int) -> Augmentation:
        """Those of every ``step``-th image from ``first`` on."""
        mine = slice(first, None, step)
        order = None if self.brightness_first is None else self.brightness_first[mine]
        chances = None if self.chances is None else self.chances[mine]
        return Augmentation(self.matrix[mine], self.brightness[mine], self.contrast[mine], order, chances)

    def zoomed(self, boxes: Tensor, side: int, shown: int, ranges: Ranges) -> Augmentation:
        """The same with scales and places for the vehicles of these pictures, as ``zoom`` of `Ranges` asks.

        A picture that shows less of the frame than there is shows the vehicle wherever all of it has room. One that
        shows more is shifted as in any ROA.

        Args:
            boxes: (B, 4) xyxy, pixels of the frame.
            side: of the frame, pixels.
            shown: the side that the moved frame is reduced to for the detectors: the frame's own detail allows scales
                ``side / shown`` times as high as the highest of ``ranges``.
        """
        assert self.chances is not None
        chances, box = self.chances, boxes.double().cpu() / side
        size, center = box[:, 2:] - box[:, :2], (box[:, :2] + box[:, 2:] - 1) / 2
        lowest, highest = ranges.scales[0], ranges.scales[1] * side / shown
        highest_here = (FILL / size.amax(1).clamp(min=1e-3)).clamp(min=lowest, max=highest)
        scale = lowest * (highest_here / lowest) ** chances[:, 0]
        turn = self.matrix[:, :, :2].double()
        turn = turn / torch.linalg.det(turn).abs().sqrt()[:, None, None] * scale[:, None, None]
        either_way, beyond = 2 * chances[:, 1:] - 1, ((scale - 1) / 2 + ranges.translation)[:, None]
        room = (0.5 - scale[:, None] * size / 2).abs()  # that the box has, or lacks, on every side of the picture
        near = either_way * room - (turn @ center[:, :, None])[:, :, 0]
        near = torch.minimum(torch.maximum(near, -beyond), beyond)  # the frame does not end inside the picture
        shift = torch.where(scale[:, None] > 1, near, either_way * ranges.translation)
        return replace(self, matrix=torch.cat([turn, shift[:, :, None]], 2).float())

    def __call__(self, images: Tensor, boxes: Tensor) -> tuple[Tensor, Tensor]:
        """Augment sRGB images (B, 3, H, W) in [0, 1] and move their boxes (B, 4) xyxy along.

        A moved box is the upright hull of the turned one, cut to the image. Values beyond [0, 1] are clipped and
        have zero gradient. As published, boxes stay.
        """
        height, width = images.shape[2:]
        if self.brightness_first is not None:
            return self.relight_as_published(self.move_images(images, backdrop=0.0)), boxes
        if images.device.type == "cpu":
            to_source = self.to_source(width, height)
            seen = augmentation_cpu.augment(images, to_source, self.brightness, self.contrast, BACKDROP)
        else:
            seen = self.relight(self.move_images(images))
        return seen, self.move_boxes(boxes, width, height)

    def to_source(self, width: int, height: int) -> Tensor:
        """(B, 2, 3) float64, from pixels of the moved image to pixels of the image."""
        matrix = self.matrix.double().cpu()
        center = torch.tensor([[width / 2], [height / 2]], dtype=torch.float64)
        inverse = torch.linalg.inv(matrix[:, :, :2])
        shift = center - inverse @ (center + matrix[:, :, 2:] * torch.tensor([[width], [height]]))
        return torch.cat([inverse, shift], 2)

    def move_images(self, images: Tensor, backdrop: float = BACKDROP) -> Tensor:
        """The affine part on images, bilinear, on any device; ``backdrop`` is sRGB, of what is left empty."""
        height, width = images.shape[2:]
        # grid_sample measures each axis in half-sides from the center.
        half = images.new_tensor([width, height]) / 2
        to_source = self.to_source(width, height).to(images)
        turn = to_source[:, :, :2] * half[None, None, :] / half[None, :, None]
        shift = (to_source @ torch.cat([half, half.new_ones(1)]) - half) / half
        grid = functional.affine_grid(torch.cat([turn, shift[..., None]], 2), list(images.shape), align_corners=False)
        moved = functional.grid_sample(images - backdrop, grid, mode="bilinear", align_corners=False)
        return moved + backdrop

    def move_boxes(self, boxes: Tensor, width: int, height: int) -> Tensor:
        """The affine part on boxes (B, 4) xyxy pixels."""
        matrix, sides = self.matrix.to(boxes), boxes.new_tensor([width, height])
        x0, y0, x1, y1 = boxes.unbind(1)
        corners = torch.stack([torch.stack(p, 1) for p in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))], 2)
        centered = corners - sides[None, :, None] / 2
        moved = matrix[:, :, :2] @ centered + (matrix[:, :, 2:] + 0.5) * sides[None, :, None]
        low = torch.minimum(moved.amin(2).clamp(min=0), sides)
        high = torch.minimum(moved.amax(2).clamp(min=0), sides)
        return torch.cat([low, high], 1)

    def relight(self, images: Tensor) -> Tensor:
        """The color part."""
        contrast = self.contrast.to(images)[:, None, None, None]
        brightness = self.brightness.to(images)[:, None, None, None]
        mean = images.mean((1, 2, 3), keepdim=True)
        return saturate((images - mean) * contrast + mean + brightness)

    def relight_as_published(self, images: Tensor) -> Tensor:
        """The color part of the public code: brightness adds, contrast multiplies, clipped after either."""
        assert self.brightness_first is not None
        factor, added = (t.to(images)[:, None, None, None] for t in (self.contrast, self.brightness))
        one, other = saturate(saturate(images + added) * factor), saturate(saturate(images * factor) + added)
        return torch.where(self.brightness_first.to(images.device)[:, None, None, None], one, other)
