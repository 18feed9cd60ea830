"""The exact environment: light maps that Blender rendered with the frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..contract import Dataset, RaucaError, load_passes


@dataclass(frozen=True, eq=False)
class Light:
    """Light maps of one frame, float32 linear.

    Attributes:
        A: (H, W, 3) light that reaches the paint and comes back through the fog, paint coverage included.
        B: (H, W, 3) everything else.
    """

    A: NDArray[np.float32]
    B: NDArray[np.float32]


def require_light(dataset: Dataset) -> None:
    """Raise :class:`RaucaError` when a data set was made without light maps."""
    if not dataset.plan.light:
        raise RaucaError(
            f"{dataset.folder}: made without light maps, to evaluate on; make a data set with light to optimize on"
        )


def load_exact(dataset: Dataset, frame_id: str) -> Light:
    """Read a frame's light maps.

    Raises:
        RaucaError: the data set was made without light maps, or the frame's are missing, damaged or not finite.
    """
    require_light(dataset)
    folder = dataset.frame_folder(frame_id)
    arrays = load_passes(folder, ("A", "B"))
    size = (dataset.plan.size, dataset.plan.size, 3)
    for name, array in arrays.items():
        if array.shape != size:
            raise RaucaError(f"{folder}/passes.npz: {name} has shape {array.shape}, expected {size}; render it again")
        if not np.isfinite(array).all():
            raise RaucaError(f"{folder}/passes.npz: {name} holds NaN or infinity; remove the frame and render it again")
    return Light(arrays["A"].astype(np.float32), arrays["B"].astype(np.float32))
