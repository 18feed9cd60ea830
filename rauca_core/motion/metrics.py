"""How well tracks follow what is there: HOTA, changes of identity, breaks.

All is by overlap (intersection over union) of boxes in each frame. `tests/motion` holds the figures equal to those of
`trackeval` on random tracks, but for breaks in frames in which a tracker says nothing at all: there `trackeval` counts
none, and we do, as that is what a camouflage does.

Sources: Luiten et al., HOTA, IJCV 129, 2021; Bernardin and Stiefelhagen, CLEAR MOT, EURASIP J. 2008.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from .tracks import Boxes

ALPHAS = np.arange(0.05, 0.99, 0.05)  # overlaps at which HOTA is taken
SAME = 0.5  # overlap from which a track's box is the thing's
ROUNDING = np.finfo(np.float64).eps
Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class Hota:
    """Means over ``ALPHAS``, each in [0, 1]: HOTA, and its parts of detection and of association."""

    hota: float
    detection: float
    association: float


@dataclass(frozen=True, eq=False)
class Followed:
    """One thing's way through the frames.

    Attributes:
        seen: (F,) whether it is there at all.
        track: (F,) id of the track that has it; 0 where none has.
    """

    seen: NDArray[np.bool_]
    track: NDArray[np.int64]

    @property
    def switches(self) -> int:
        """How often another track has it than the one that had it last."""
        had = self.track[self.track > 0]
        return int((had[1:] != had[:-1]).sum())

    @property
    def breaks(self) -> int:
        """How often it is lost and found again."""
        has = np.concatenate([[False], self.track > 0])
        return max(int((has[1:] & ~has[:-1]).sum()) - 1, 0)


def overlap(a: Matrix, b: Matrix) -> Matrix:
    """(N, 4) and (M, 4) xyxy -> (N, M) intersection over union."""
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.clip(high - low, 0.0, None).prod(2)
    area_a, area_b = ((c[:, 2:] - c[:, :2]).clip(0.0).prod(1) for c in (a, b))
    return np.asarray(shared / np.maximum(area_a[:, None] + area_b[None] - shared, ROUNDING))


def hota(truth: Sequence[Boxes], tracks: Sequence[Boxes]) -> Hota:
    """HOTA of a clip; ids are whole numbers, and none comes twice in a frame."""
    overlaps = [overlap(t.xyxy, p.xyxy) for t, p in zip(truth, tracks, strict=True)]
    rows, columns = _numbered(truth), _numbered(tracks)
    aligned = _alignment(overlaps, rows, columns)
    shape = (len(ALPHAS), *aligned.shape)
    together, hits = np.zeros(shape), np.zeros(len(ALPHAS))
    for same, row, column in zip(overlaps, rows, columns, strict=True):
        i, j = linear_sum_assignment(aligned[np.ix_(row, column)] * same, maximize=True)
        matched = same[i, j][None] >= ALPHAS[:, None] - ROUNDING
        hits += matched.sum(1)
        together[:, row[i], column[j]] += matched
    count_t, count_p = (np.bincount(np.concatenate(n), minlength=k) for n, k in ((rows, shape[1]), (columns, shape[2])))
    either = np.maximum(count_t[:, None] + count_p[None] - together, 1.0)
    association = (together**2 / either).sum((1, 2)) / np.maximum(hits, 1.0)
    detection = hits / np.maximum(count_t.sum() + count_p.sum() - hits, 1.0)
    return Hota(*(float(part.mean()) for part in (np.sqrt(detection * association), detection, association)))


def follow(truth: Sequence[Boxes], tracks: Sequence[Boxes]) -> dict[int, Followed]:
    """Which track has each thing in each frame, matched as CLEAR MOT does: who had it keeps it while it overlaps."""
    ids = sorted({int(i) for boxes in truth for i in boxes.values})
    seen = {i: np.zeros(len(truth), bool) for i in ids}
    has = {i: np.zeros(len(truth), np.int64) for i in ids}
    last: dict[int, int] = {}
    for frame, (there, told) in enumerate(zip(truth, tracks, strict=True)):
        for i in there.values.tolist():
            seen[i][frame] = True
        if not len(there) or not len(told):
            continue
        same = overlap(there.xyxy, told.xyxy)
        kept = np.array([[last.get(i) == j for j in told.values.tolist()] for i in there.values.tolist()])
        worth = np.where(same >= SAME - ROUNDING, same + 1000.0 * kept, 0.0)
        rows, columns = linear_sum_assignment(worth, maximize=True)
        pairs = [(r, c) for r, c in zip(rows, columns, strict=True) if worth[r, c] > ROUNDING]
        last = {int(there.values[r]): int(told.values[c]) for r, c in pairs}
        for i, j in last.items():
            has[i][frame] = j
    return {i: Followed(seen[i], has[i]) for i in ids}


def _numbered(frames: Sequence[Boxes]) -> list[NDArray[np.int64]]:
    """The ids of each frame, as numbers from 0 without holes."""
    ids = sorted({int(i) for boxes in frames for i in boxes.values})
    number = {i: n for n, i in enumerate(ids)}
    return [np.array([number[int(i)] for i in boxes.values], np.int64) for boxes in frames]


def _alignment(
    overlaps: Sequence[Matrix], rows: Sequence[NDArray[np.int64]], columns: Sequence[NDArray[np.int64]]
) -> Matrix:
    """(T, P) how much of a thing's and a track's lives they share: the paper's association before it is known."""
    size_t, size_p = (max((int(n.max()) + 1 for n in numbers if n.size), default=0) for numbers in (rows, columns))
    shared, count_t, count_p = np.zeros((size_t, size_p)), np.zeros(size_t), np.zeros(size_p)
    for same, row, column in zip(overlaps, rows, columns, strict=True):
        either = same.sum(0)[None] + same.sum(1)[:, None] - same
        share = np.divide(same, either, out=np.zeros_like(same), where=either > ROUNDING)
        shared[np.ix_(row, column)] += share
        count_t[row] += 1
        count_p[column] += 1
    return np.asarray(shared / np.maximum(count_t[:, None] + count_p[None] - shared, ROUNDING))
