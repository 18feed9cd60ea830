"""Light maps where nobody rendered any: data sets made without light, other simulators, photographs.

The extractor looks at the vehicle's surroundings, and leaves the rest of the frame alone.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..contract import Dataset, color
from ..render import srgb_to_linear
from .dichromatic import split_colors
from .exact import Light
from .extractor import LightSplitter
from .frames import read_picture

MARGIN = 0.5  # around the paint's box, in its longer sides
LEAST_MARGIN_PX = 16


def split_light(
    net: LightSplitter, image_srgb: Tensor, mask: Tensor, reference_linear: Tensor
) -> tuple[Tensor, Tensor]:
    """Light maps of one frame, without gradients.

    Args:
        image_srgb: (3, H, W) in [0, 1], in the reference paint.
        mask: (1, H, W) coverage of the paint.
        reference_linear: (3,) albedo of the reference paint.

    Returns:
        A and B, (3, H, W) linear float32; away from the vehicle A is 0 and B the image.
    """
    A, B = torch.zeros_like(image_srgb, dtype=torch.float32), srgb_to_linear(image_srgb.float())
    window = surroundings(mask[0] > 0)
    if window is None:
        return A, B
    device, inside = next(net.parameters()).device, (..., *window)
    with torch.no_grad():
        inputs = (image_srgb[inside][None], mask[inside][None], reference_linear[None])
        found = net(*(t.to(device) for t in inputs))
    gain, rest = (maps[0].to(A) for maps in found)
    A[inside], B[inside] = split_colors(gain, rest, mask[inside], reference_linear)
    return A, B


def surroundings(painted: Tensor) -> tuple[slice, slice] | None:
    """Rows and columns of a mask's (H, W) box and its margin; None when the mask is empty."""
    rows, columns = (torch.nonzero(painted.any(dim=axis))[:, 0] for axis in (1, 0))
    if len(rows) == 0:
        return None
    ends = [(int(at[0]), int(at[-1]) + 1) for at in (rows, columns)]
    margin = max(LEAST_MARGIN_PX, round(MARGIN * max(end - start for start, end in ends)))
    row, column = (
        slice(max(start - margin, 0), min(end + margin, size))
        for (start, end), size in zip(ends, painted.shape, strict=True)
    )
    return row, column


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
    albedo = torch.from_numpy(color.srgb_to_linear(np.array(reference_srgb) / 255.0))
    mask = torch.from_numpy(np.asarray(paint, np.float32))[None]
    return Light(*(m.permute(1, 2, 0).numpy() for m in split_light(extractor, pixels, mask, albedo)))
