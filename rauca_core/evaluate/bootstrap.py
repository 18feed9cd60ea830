"""How far average precision would move with other frames: a percentile bootstrap over frames.

Detections of one frame never depend on another frame, so a frame's hits and misses are found once and each resample
only changes how often the frame counts. All paints and detectors share the resamples, so their differences are paired.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..contract.seeding import named_rng
from .average_precision import IOU_THRESHOLD, MAX_DETECTIONS, Sample

CONFIDENCE = 0.95
_RECALLS = np.linspace(0, 1, 101)


def resample_counts(frames: int, resamples: int, seed: int) -> NDArray[np.int64]:
    """(resamples, frames): how often each frame is drawn; rows sum to ``frames``."""
    return named_rng("bootstrap", seed).multinomial(frames, np.full(frames, 1 / frames), size=resamples)


def resampled_average_precision(samples: Sequence[Sample], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """(resamples,) AP@0.5 of ``samples`` when frame f counts ``counts[:, f]`` times; 101-point interpolation."""
    frame, hit = _ranked(samples)
    result = np.zeros(len(counts))
    if not hit.any():
        return result
    for row, count in enumerate(counts):
        weight = count[frame]
        seen = np.cumsum(weight)
        true = np.cumsum(weight * hit)
        precision = true / np.maximum(seen, 1)
        envelope = np.maximum.accumulate(precision[::-1])[::-1]
        rank = np.searchsorted(true / count.sum(), _RECALLS)
        result[row] = np.append(envelope, 0.0)[rank].mean()
    return result


def interval(resampled: NDArray[np.float64]) -> tuple[float, float]:
    """The central 95 % of resampled values."""
    low, high = np.quantile(resampled, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def _ranked(samples: Sequence[Sample]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Every detection of every frame, best first: its frame and whether it is the one that finds the target."""
    frames, scores, hits = [], [], []
    for index, sample in enumerate(samples):
        order = np.argsort(-sample.scores, kind="stable")[:MAX_DETECTIONS]
        overlapping = box_overlaps(sample.boxes[order], sample.truth) >= IOU_THRESHOLD
        first = np.zeros(len(order), bool)
        first[np.flatnonzero(overlapping)[:1]] = True
        frames.append(np.full(len(order), index))
        scores.append(sample.scores[order])
        hits.append(first)
    rank = np.argsort(-np.concatenate(scores), kind="stable")
    return np.concatenate(frames)[rank], np.concatenate(hits)[rank]


def box_overlaps(boxes: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Intersection over union of (M, 4) xyxy boxes with one (4,) box: (M,)."""
    sides = np.minimum(boxes[:, 2:], truth[2:]) - np.maximum(boxes[:, :2], truth[:2])
    shared = np.clip(sides, 0, None).prod(1)
    areas = (boxes[:, 2:] - boxes[:, :2]).prod(1) + (truth[2:] - truth[:2]).prod()
    return shared / np.maximum(areas - shared, 1e-12)
