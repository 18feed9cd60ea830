"""Pictures without their vehicle, to see what a detector says of everything else."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..contract import Frame
from ..detect.letterbox import PADDING_SRGB

MARGIN = 0.15  # of the vehicle's width to either side, for its shadow


def without_vehicle(pixels: NDArray[np.uint8], frame: Frame) -> NDArray[np.uint8]:
    """(H, W, 3) sRGB with the columns of the frame's vehicle in the grey that letterboxes have."""
    assert frame.box_xyxy is not None
    left, _, right, _ = frame.box_xyxy
    margin = MARGIN * (right - left)
    vacant = pixels.copy()
    vacant[:, max(0, int(left - margin)) : int(np.ceil(right + margin))] = round(255 * PADDING_SRGB)
    return vacant
