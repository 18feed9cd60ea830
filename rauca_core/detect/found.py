"""What a detector found in an image, by class names: what is kept, compared and drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Found:
    """Detections of one image, best first: boxes (M, 4) xyxy pixels, scores (M,), canonical class names (M,)."""

    boxes: NDArray[np.float64]
    scores: NDArray[np.float64]
    names: tuple[str, ...]

    def only(self, name: str) -> Found:
        """Those of one class."""
        keep = np.array([n == name for n in self.names], bool)
        return Found(self.boxes[keep], self.scores[keep], (name,) * int(keep.sum()))
