"""What a detector is shown: frames in plain paint, nearer or farther, in other light, alone or four in one image.

Paints are colors that cars are sold in, one or two per car, never a pattern or noise: the detectors stand for those
that nobody hardened, and what these have seen of paint is what a street shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..contract.color import srgb_to_linear
from ..detect.letterbox import PADDING_SRGB
from ..detect.synth.network import Truth
from ..environment.frames import LightFrames
from ..render import linear_to_srgb
from ..render.straight_through import straight_through

CAR_COLORS: tuple[tuple[int, int, int], ...] = (
    (238, 238, 235), (205, 207, 208), (160, 163, 166), (110, 113, 117), (64, 66, 70), (18, 18, 20),
    (150, 20, 26), (190, 40, 30), (92, 14, 24), (24, 58, 122), (40, 96, 170), (14, 26, 58), (110, 150, 190),
    (30, 72, 48), (90, 110, 60), (214, 170, 40), (206, 96, 30), (196, 180, 150), (110, 78, 54), (96, 60, 110),
)  # fmt: skip
"""8-bit sRGB: whites, greys and blacks first, for they are most of the traffic."""

NEUTRALS = 6
SHARES = (0.45, 0.35, 0.2)  # a neutral one, any of the list, any color at all
TWO_TONE = 0.15
_SPREAD = 12.0  # 8-bit values: no two whites are alike


def draw_color(rng: np.random.Generator) -> NDArray[np.float32]:
    """(3,) linear albedo of a car's paint."""
    kind = rng.choice(3, p=SHARES)
    if kind == 2:
        return srgb_to_linear(rng.random(3))
    chosen = CAR_COLORS[rng.integers(NEUTRALS if kind == 0 else len(CAR_COLORS))]
    return srgb_to_linear((np.array(chosen) + rng.normal(0, _SPREAD, 3)) / 255)


def draw_paint(rng: np.random.Generator, rows: tuple[float, float], size: int) -> Tensor:
    """A car's paint: (3, 1, 1) linear albedo, or two-tone (3, H, 1), roof and body in a color each.

    Args:
        rows: top and bottom of the car's box, pixels.
        size: H, pixels.
    """
    body = torch.from_numpy(draw_color(rng))[:, None, None]
    if rng.random() >= TWO_TONE:
        return body
    roof = torch.from_numpy(draw_color(rng))[:, None, None]
    top, bottom = rows
    edge = top + (bottom - top) * rng.uniform(0.25, 0.6)
    above = (torch.arange(size) + 0.5 < edge)[None, :, None]
    return torch.where(above, roof, body)


FOUR = 0.35  # share of images that show four frames
ZOOM = (0.4, 1.8)  # of a frame that fills the image
ZOOM_FOUR = (0.7, 1.5)  # of one in its quarter
SMALLEST_SIDE = 5.0  # pixels; what is smaller could not be told from its surroundings
SEEN = 0.35  # share of a box that must be left by a crop
JPEG = 0.3
BLUR = 0.3


@dataclass(frozen=True, eq=False)
class Sample:
    """An image with its truth: (3, S, S) float32 sRGB in [0, 1]."""

    image: Tensor
    truth: Truth


class Samples:
    """Frames as detectors see them.

    Args:
        frames: data sets with light maps.
        class_names: what is annotated; other vehicles stay unmarked, as background.
        size: S of an image, pixels.
        alone: annotate the frames' own vehicles and none that stand around.
    """

    def __init__(self, frames: LightFrames, class_names: Sequence[str], size: int, alone: bool = False) -> None:
        self.frames, self.size, self._alone = frames, size, alone
        self.class_names = tuple(class_names)

    def plain(self, index: int, rng: np.random.Generator) -> Sample:
        """The whole frame at its own size in a random plain paint, nothing else changed: to test on."""
        return Sample(linear_to_srgb(self.painted(index, rng)), self.truth(index))

    def painted(self, index: int, rng: np.random.Generator) -> Tensor:
        """The frame in a plain paint drawn for it, ``A * albedo + B``: (3, H, W) float32 linear, not clipped."""
        frame, box = self.frames.get(index), self.frames.places[index].frame.box_xyxy
        assert box is not None  # LightFrames has none without
        return frame.A.float() * draw_paint(rng, (box[1], box[3]), frame.A.shape[1]) + frame.B.float()

    def draw(self, indices: Sequence[int], rng: np.random.Generator, paint: Tensor | None = None) -> Sample:
        """One image of one frame, or of four; see the module. Differentiable in what :meth:`painted` is.

        Args:
            paint: the vehicle's, (3, 1, 1) linear albedo, in place of the one that is drawn; nothing else becomes
                another.
        """
        if len(indices) == 1:
            found = self._placed(indices[0], self.size, ZOOM, rng, paint)
        else:
            found = _quarters([self._placed(i, self.size // 2, ZOOM_FOUR, rng, paint) for i in indices])
        seen = torch.from_numpy(_camera(found.image.detach(), rng))
        return Sample(straight_through(found.image, seen), found.truth)

    def truth(self, index: int) -> Truth:
        """Boxes of the frame's vehicles that have a class."""
        frame = self.frames.places[index].frame
        own = self.frames.vehicle(index).category
        around = () if self._alone else frame.instances
        marked = [(own, frame.box_xyxy), *((i.category, i.box_xyxy) for i in around)]
        known = [(self.class_names.index(name), box) for name, box in marked if name in self.class_names]
        boxes = torch.tensor([box for _, box in known], dtype=torch.float32).view(-1, 4)
        return Truth(boxes, torch.tensor([label for label, _ in known], dtype=torch.int64))

    def _placed(
        self, index: int, side: int, zooms: tuple[float, float], rng: np.random.Generator, paint: Tensor | None
    ) -> Sample:
        """The frame scaled by a random zoom into a square of ``side``, mirrored half the time; grey around."""
        linear = self.painted(index, rng)
        if paint is not None:
            light = self.frames.get(index)
            linear = light.A.float() * paint + light.B.float()
        linear = linear * 2.0 ** rng.uniform(-0.8, 0.8)
        image, truth = linear_to_srgb(linear), self.truth(index)
        own = image.shape[2]
        if rng.random() < 0.5:
            boxes = truth.boxes
            turned = torch.stack([own - boxes[:, 2], boxes[:, 1], own - boxes[:, 0], boxes[:, 3]], 1)
            image, truth = image.flip(2), Truth(turned, truth.labels)
        scale = side / own * float(np.exp(rng.uniform(*np.log(zooms))))
        scaled = max(8, round(own * scale))
        scale = scaled / own
        image = functional.interpolate(image[None], size=(scaled, scaled), mode="bilinear", antialias=True)[0]
        box = self.frames.places[index].frame.box_xyxy
        focus = truth.boxes[0] if len(truth.boxes) else torch.tensor(box)
        left, top = (_offset(float(focus[k]) * scale, float(focus[k + 2]) * scale, scaled, side, rng) for k in (0, 1))
        canvas = torch.full((3, side, side), PADDING_SRGB)
        x0, y0, x1, y1 = max(0, left), max(0, top), min(side, left + scaled), min(side, top + scaled)
        canvas[:, y0:y1, x0:x1] = image[:, y0 - top : y1 - top, x0 - left : x1 - left]
        return Sample(canvas, _cropped(truth, scale, (left, top), side))


def _offset(low: float, high: float, scaled: int, side: int, rng: np.random.Generator) -> int:
    """Where the scaled frame begins along one axis, so that at least 60 % of ``low`` to ``high`` stays inside."""
    slack = 0.4 * (high - low)
    least, most = -low - slack, side - high + slack
    if scaled >= side:  # no grey needed: stay within the frame where the vehicle allows it
        least, most = max(least, side - scaled), min(most, 0.0)
    else:
        least, most = max(least, 0.0), min(most, float(side - scaled))
    return round(rng.uniform(min(least, most), max(least, most)))


def _cropped(truth: Truth, scale: float, corner: tuple[int, int], side: int) -> Truth:
    """Boxes in the square; those that it cuts down to too little are dropped."""
    whole = truth.boxes * scale + torch.tensor([*corner, *corner], dtype=torch.float32)
    boxes = whole.clamp(0, side)
    extent, before = boxes[:, 2:] - boxes[:, :2], whole[:, 2:] - whole[:, :2]
    kept = (extent.amin(1) >= SMALLEST_SIDE) & (extent.prod(1) >= SEEN * before.prod(1))
    return Truth(boxes[kept], truth.labels[kept])


def _quarters(parts: Sequence[Sample]) -> Sample:
    """Four squares as one."""
    side = parts[0].image.shape[1]
    image = torch.cat([torch.cat([parts[k].image, parts[k + 1].image], 2) for k in (0, 2)], 1)
    shifts = [torch.tensor([k % 2, k // 2, k % 2, k // 2]) * float(side) for k in range(4)]
    boxes = torch.cat([part.truth.boxes + shift for part, shift in zip(parts, shifts, strict=True)])
    return Sample(image, Truth(boxes, torch.cat([part.truth.labels for part in parts])))


def _camera(image: Tensor, rng: np.random.Generator) -> np.ndarray:
    """What cameras and their software do: contrast, saturation, white balance, blur, JPEG."""
    pixels = image.numpy().transpose(1, 2, 0)
    grey = pixels.mean(2, keepdims=True)
    pixels = grey + (pixels - grey) * np.float32(rng.uniform(0.6, 1.3))
    pixels = 0.5 + (pixels - 0.5) * np.float32(rng.uniform(0.75, 1.2)) + np.float32(rng.uniform(-0.08, 0.08))
    pixels = pixels * rng.uniform(0.94, 1.06, 3).astype(np.float32)
    if rng.random() < BLUR:
        pixels = cv2.GaussianBlur(pixels, (0, 0), rng.uniform(0.3, 1.2))
    pixels = np.clip(pixels, 0, 1)
    if rng.random() < JPEG:
        quality = int(rng.integers(35, 95))
        _, coded = cv2.imencode(".jpg", (pixels * 255 + 0.5).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, quality])
        pixels = cv2.imdecode(coded, cv2.IMREAD_COLOR).astype(np.float32) / 255
    return np.ascontiguousarray(pixels.transpose(2, 0, 1), dtype=np.float32)
