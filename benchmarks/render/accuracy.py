"""How far each renderer is from 256 samples per pixel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.render import Taps

from .reference import Reference, raster_sees, render_reference
from .scenes import Scene


def psnr_db(squared_errors: NDArray[np.floating]) -> float:
    """Peak signal-to-noise ratio of values in [0, 1]; infinite for a perfect match."""
    mean = float(np.mean(squared_errors, dtype=np.float64))
    return float(-10 * np.log10(mean)) if mean > 0 else float("inf")


def premultiplied(taps: Taps, texels: Tensor) -> NDArray[np.float32]:
    """The paint layer (H, W, 3), linear: coverage times coverage-normalized texture, black elsewhere."""
    paint = torch.from_numpy(taps.alpha)[:, None] * taps.rows(texels)
    return taps.to_image(paint, torch.zeros(3, taps.height, taps.width)).permute(1, 2, 0).contiguous().numpy()


def ring_psnr_db(scene: Scene, taps: Sequence[Taps], texture: int) -> float:
    """PSNR over all pixels of all views that show paint: near views, which show more of it, count for more."""
    errors = [
        squared_error(reference, premultiplied(view, scene.car.texels[texture]), texture)
        for view, reference in zip(taps, scene.references, strict=True)
    ]
    return psnr_db(np.concatenate(errors))


def reference_check(scene: Scene, samples: int) -> float:
    """PSNR between the first view's reference and the same with our rasterizer's visibility instead of Embree's."""
    car, camera, reference = scene.car, scene.cameras[0], scene.references[0]
    other = render_reference(car.vehicle, raster_sees(car.vehicle, camera, samples), camera, car.maps, samples)
    return psnr_db((other.colors - reference.colors)[:, reference.coverage > 0] ** 2)


def squared_error(reference: Reference, image: NDArray[np.float32], texture: int) -> NDArray[np.float64]:
    """(R, 3) on the pixels that show paint, in the reference or in the image."""
    shown = (reference.coverage > 0) | (image > 0).any(2)
    return np.asarray((image[shown] - reference.colors[texture][shown]) ** 2, np.float64)
