"""COCO's run-length encoding of masks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def encode_mask(mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Uncompressed COCO RLE of an (H, W) mask: runs of unset and set pixels in turn, column after column."""
    columns = np.asarray(mask, bool).T.ravel()
    changes = np.flatnonzero(columns[1:] != columns[:-1]) + 1
    runs = np.diff(np.concatenate([[0], changes, [columns.size]])).tolist()
    return {"size": list(mask.shape), "counts": [0, *runs] if columns[0] else runs}
