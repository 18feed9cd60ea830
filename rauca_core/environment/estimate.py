"""Light maps where nobody rendered any: data sets made without light, other simulators, photographs."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from ..contract import Dataset
from ..contract.color import srgb_to_linear
from .exact import Light
from .extractor import LightSplitter
from .focus import split_light
from .frames import read_picture


def estimate(dataset: Dataset, frame_id: str, extractor: LightSplitter) -> Light:
    """The light of a frame as the extractor sees it: what ``load_exact`` reads, without its files.

    Args:
        dataset: with or without light maps.
        extractor: from :func:`weights.load_extractor`.

    Raises:
        RaucaError: the frame's image or mask is missing or damaged.
    """
    folder, size = dataset.frame_folder(frame_id), dataset.plan.size
    image = read_picture(folder / "image.png", size).permute(1, 2, 0).numpy()
    paint = read_picture(folder / "paint.png", size, grey=True)[0].numpy()
    return estimate_image(image, paint / np.float32(255), dataset.plan.reference_srgb, extractor)


def estimate_image(
    image_srgb: NDArray[np.uint8],
    paint: NDArray[np.float32],
    reference_srgb: tuple[int, int, int],
    extractor: LightSplitter,
) -> Light:
    """The light of any image.

    Args:
        image_srgb: (H, W, 3) 8-bit.
        paint: (H, W) coverage of the paint in [0, 1].
        reference_srgb: 8-bit color of the paint in the image.
    """
    pixels = torch.from_numpy(image_srgb.transpose(2, 0, 1).astype(np.float32) / 255)
    albedo = torch.from_numpy(srgb_to_linear(np.array(reference_srgb) / 255.0))
    mask = torch.from_numpy(np.asarray(paint, np.float32))[None]
    return Light(*(m.permute(1, 2, 0).numpy() for m in split_light(extractor, pixels, mask, albedo)))
