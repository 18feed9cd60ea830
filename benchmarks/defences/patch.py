"""A square patch on the vehicle, optimized against one detector: what these defences were made for."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from rauca_core.attack.losses import attack_loss
from rauca_core.detect import Detector, car_score

from .views import Views

SIDE = 48  # texels


def patch_area(box: Tensor, share: float) -> tuple[int, int, int]:
    """Left, top and side of the patch in the middle of a box (4,), pixels; it covers ``share`` of the box."""
    width, height = (float(x) for x in box[2:] - box[:2])
    side = max(2, round((share * width * height) ** 0.5))
    left, top = (float(box[i] + box[i + 2] - side) / 2 for i in (0, 1))
    return round(left), round(top), side


def paste(images: Tensor, boxes: Tensor, patch: Tensor, share: float) -> Tensor:
    """Images (B, 3, H, W) with the patch (3, SIDE, SIDE) over ``share`` of each box (B, 4); differentiable."""
    pasted = []
    for image, box in zip(images, boxes, strict=True):
        left, top, side = patch_area(box, share)
        x, y = max(left, 0), max(top, 0)
        resized = functional.interpolate(patch[None], (side, side), mode="bilinear", antialias=True)[0].clamp(0, 1)
        shown = resized[:, y - top : image.shape[1] - top, x - left : image.shape[2] - left]
        margins = (x, image.shape[2] - x - shown.shape[2], y, image.shape[1] - y - shown.shape[1])
        covered = functional.pad(torch.ones_like(shown), margins)
        pasted.append(image * (1 - covered) + functional.pad(shown, margins))
    return torch.stack(pasted)


def optimize_patch(
    detector: Detector,
    views: Views,
    share: float,
    steps: int,
    progress: Callable[[int, int], None],
    batch: int = 4,
    seed: int = 0,
) -> Tensor:
    """A patch (3, SIDE, SIDE) that lowers the detector's car score on the normal vehicle, by Adam."""
    generator = torch.Generator().manual_seed(seed)
    patch = torch.rand(3, SIDE, SIDE, generator=generator).requires_grad_()
    optimizer = torch.optim.Adam([patch], lr=0.03)
    for step in range(steps):
        chosen = torch.randint(len(views.frames), (batch,), generator=generator)
        images, boxes = views.paints["normal"][chosen], views.boxes[chosen]
        loss = attack_loss(car_score(detector, paste(images, boxes, patch, share), boxes)).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        with torch.no_grad():
            patch.clamp_(0, 1)
        progress(step + 1, steps)
    return patch.detach()
