"""Random output augmentation (ROA): the rendered image is moved, scaled and relit before the detector sees it.

Unlike in the public code, the ground-truth box moves with the image; ``published`` is that code's: there it stays.

``crops`` shows a part of the frame around the vehicle, drawn anew at every step: how large the vehicle looks no longer
hangs on where the camera stood, and little of a step is spent on the street around it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ..render import saturate
from . import augmentation_cpu

CROP = 320  # pixels a side: a larger frame costs no more than one of these, and shows the vehicle as sharp as it is
# How much a crop may enlarge a frame: below, bilinear sampling would leave out pixels; above, the paint is a blur.
ENLARGED = (0.4, 2.0)
BACKDROP = 0.5  # sRGB grey where the moved image leaves the frame empty, like a letterbox's border


AugmentationName = Literal["rauca", "active", "mirrored", "crops", "published"]


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
        vehicle: lowest and highest share of the picture's side that the vehicle's longer side takes, drawn along a
            logarithm; in place of ``scales``, and about the vehicle's middle. None leaves it where the camera saw it.
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
    vehicle: tuple[float, float] | None = None
    as_published: bool = False


RANGES: dict[AugmentationName, Ranges] = {
    "rauca": Ranges(),
    "active": Ranges(rotation_deg=0.0, scales=(0.25, 1.0), jitter=1.0),
    "mirrored": Ranges(scales=(0.6, 1.2), mirror=0.5),
    "crops": Ranges(vehicle=(0.3, 1.2), mirror=0.5),
    # kornia's RandomAffine moves every second image where it is not told otherwise, and the public code does not.
    "published": Ranges(move=0.5, as_published=True),
}


@dataclass(frozen=True)
class Placement:
    """Where the pixels of a batch go.

    Attributes:
        to_target: (B, 2, 3) float64, from pixels (x, y, 1) of the image to pixels of what is shown.
        width, height: of what is shown, pixels.
    """

    to_target: Tensor
    width: int
    height: int

    @property
    def to_source(self) -> Tensor:
        """(B, 2, 3) float64, the way back."""
        inverse = torch.linalg.inv(self.to_target[:, :, :2])
        return torch.cat([inverse, -inverse @ self.to_target[:, :, 2:]], 2)

    def images(self, images: Tensor, backdrop: float = BACKDROP) -> Tensor:
        """Images (B, 3, H, W) moved, bilinear, on any device; ``backdrop`` is sRGB, of what is left empty."""
        # grid_sample measures each axis in half-sides from the center.
        source = images.new_tensor([images.shape[3], images.shape[2]]) / 2
        shown = images.new_tensor([self.width, self.height]) / 2
        to_source = self.to_source.to(images)
        turn = to_source[:, :, :2] * shown[None, None, :] / source[None, :, None]
        shift = (to_source @ torch.cat([shown, shown.new_ones(1)]) - source) / source
        size = [*images.shape[:2], self.height, self.width]
        grid = functional.affine_grid(torch.cat([turn, shift[..., None]], 2), size, align_corners=False)
        moved = functional.grid_sample(images - backdrop, grid, mode="bilinear", align_corners=False)
        return moved + backdrop

    def boxes(self, boxes: Tensor) -> Tensor:
        """Boxes (B, 4) xyxy pixels moved: the upright hull of the turned ones, cut to what is shown."""
        matrix, sides = self.to_target.to(boxes), boxes.new_tensor([self.width, self.height])
        x0, y0, x1, y1 = boxes.unbind(1)
        corners = torch.stack([torch.stack(p, 1) for p in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))], 2)
        moved = matrix[:, :, :2] @ corners + matrix[:, :, 2:]
        low = torch.minimum(moved.amin(2).clamp(min=0), sides)
        high = torch.minimum(moved.amax(2).clamp(min=0), sides)
        return torch.cat([low, high], 1)


@dataclass(frozen=True)
class Augmentation:
    """One drawn augmentation per image of a batch.

    Attributes:
        matrix: (B, 2, 3) source to target in centered pixels: ``target = matrix @ (x - W/2, y - H/2, 1)``, in units of
            the image's side for the translation.
        brightness: (B,) offset; 0 leaves the image alone.
        contrast: (B,) factor; 1 leaves the image alone.
        brightness_first: (B,) bool, only as published: whether brightness comes before contrast.
        vehicle: (B,) share of the shown side that the vehicle's longer side takes; None where frames are not cropped.
    """

    matrix: Tensor
    brightness: Tensor
    contrast: Tensor
    brightness_first: Tensor | None = None
    vehicle: Tensor | None = None

    @staticmethod
    def draw(rng: np.random.Generator, batch: int, ranges: Ranges = RANGES["rauca"]) -> Augmentation:
        """Draw from a named generator, see ``contract.seeding``."""
        angle = np.radians(rng.uniform(-ranges.rotation_deg, ranges.rotation_deg, batch))
        scale = rng.uniform(*ranges.scales, batch) if ranges.vehicle is None else np.ones(batch)
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
        vehicle = None
        if ranges.vehicle is not None:
            low, high = np.log(ranges.vehicle)
            vehicle = torch.tensor(np.exp(rng.uniform(low, high, batch)))
        return Augmentation(matrix, added, factor, first, vehicle)

    def part(self, first: int, step: int) -> Augmentation:
        """Those of every ``step``-th image from ``first`` on."""
        mine = slice(first, None, step)
        order = None if self.brightness_first is None else self.brightness_first[mine]
        vehicle = None if self.vehicle is None else self.vehicle[mine]
        return Augmentation(self.matrix[mine], self.brightness[mine], self.contrast[mine], order, vehicle)

    def __call__(self, images: Tensor, boxes: Tensor, side: int | None = None) -> tuple[Tensor, Tensor]:
        """Augment sRGB images (B, 3, H, W) in [0, 1] and move their boxes (B, 4) xyxy along.

        A moved box is the upright hull of the turned one, cut to what is shown. Values beyond [0, 1] are clipped and
        have zero gradient. As published, boxes stay.

        Args:
            side: of a crop, pixels; that of the images when None, but no more than `CROP`.
        """
        height, width = images.shape[2:]
        if self.brightness_first is not None:
            moved = self.place(boxes, width, height).images(images, backdrop=0.0)
            return self.relight_as_published(moved), boxes
        place = self.place(boxes, width, height, side)
        if images.device.type == "cpu":
            size = place.width, place.height
            seen = augmentation_cpu.augment(images, place.to_source, self.brightness, self.contrast, BACKDROP, size)
        else:
            seen = self.relight(place.images(images))
        return seen, place.boxes(boxes)

    def place(self, boxes: Tensor, width: int, height: int, side: int | None = None) -> Placement:
        """Where the pixels of images of this size go, whose vehicles are at ``boxes`` (B, 4) xyxy."""
        turn, shift = self.matrix.double().cpu().split([2, 1], 2)
        if self.vehicle is None:
            sides = torch.tensor([[width], [height]], dtype=torch.float64)
            center = sides / 2
            return Placement(torch.cat([turn, shift * sides + center - turn @ center], 2), width, height)
        side = side or min(max(width, height), CROP)
        low, high = boxes.double().cpu().split(2, 1)
        longer = (high - low).amax(1).clamp(min=1.0)
        turn = turn * (self.vehicle.double() * side / longer).clamp(*ENLARGED)[:, None, None]
        middle = ((low + high) / 2)[..., None]
        return Placement(torch.cat([turn, (shift + 0.5) * side - turn @ middle], 2), side, side)

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
