"""How far average precision would move in other places: a percentile bootstrap over clusters of frames.

Frames of one location share its street, its light and its cameras, so they are no independent draws: a resample draws
locations, each with all of its frames. All paints and detectors share the resamples, so their differences are paired.

Detections of one frame never depend on another frame, so a frame's hits and misses are found once; a resample only
changes how often they count, which makes all resamples of a ranking one matrix product.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..contract.seeding import named_rng
from .average_precision import IOU_THRESHOLD, MAX_DETECTIONS, Sample

CONFIDENCE = 0.95
_RECALLS = np.linspace(0, 1, 101)


@dataclass(frozen=True, eq=False)
class Clusters:
    """Which frames are drawn together.

    Attributes:
        kind: ``"locations"``; with a single location ``"views"`` (cameras), and with a single view ``"frames"``.
        of_frame: (F,) cluster of each frame, counted from 0.
    """

    kind: str
    of_frame: NDArray[np.int64]

    @property
    def count(self) -> int:
        return int(self.of_frame.max()) + 1

    @staticmethod
    def of(locations: Sequence[int], views: Sequence[int]) -> Clusters:
        """The coarsest clusters of which there are at least two.

        Args:
            locations, views: of each frame, at least one.
        """
        for kind, values in (("locations", locations), ("views", views)):
            distinct, index = np.unique(np.asarray(values), return_inverse=True)
            if len(distinct) > 1:
                return Clusters(kind, index.astype(np.int64))
        return Clusters("frames", np.arange(len(locations)))

    def resample(self, resamples: int, seed: int) -> NDArray[np.int64]:
        """(resamples, count): how often each cluster is drawn; rows sum to ``count``."""
        share = np.full(self.count, 1 / self.count)
        return named_rng("bootstrap", seed).multinomial(self.count, share, size=resamples)


@dataclass(frozen=True, eq=False)
class Ranking:
    """Every detection of every frame, best first.

    Attributes:
        frame: (N,) the frame it was made in, 0 to F - 1.
        hit: (N,) whether it is the one that finds the frame's target.
        frames: F.
    """

    frame: NDArray[np.int64]
    hit: NDArray[np.bool_]
    frames: int

    @staticmethod
    def of(samples: Sequence[Sample]) -> Ranking:
        """Rank as COCO does: the best 100 of each frame; equal scores in the order of frames, then of detections."""
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
        return Ranking(np.concatenate(frames)[rank], np.concatenate(hits)[rank], len(samples))

    def part(self, chosen: NDArray[np.int64]) -> Ranking:
        """The ranking of some frames, (P,) ascending; they count from 0 in the result."""
        place = np.full(self.frames, -1)
        place[chosen] = np.arange(len(chosen))
        keep = place[self.frame] >= 0
        return Ranking(place[self.frame[keep]], self.hit[keep], len(chosen))

    def average_precision(self, counts: NDArray[np.int64], cluster: NDArray[np.int64]) -> NDArray[np.float64]:
        """AP@0.5, 101-point interpolation; that of :func:`average_precision`, by another way.

        Args:
            counts: (R, C) how often each cluster counts.
            cluster: (F,) cluster of each frame.

        Returns:
            (R,) in [0, 1].
        """
        found = np.flatnonzero(self.hit)
        if not len(found):
            return np.zeros(len(counts))
        weight = counts.T.astype(np.float64)
        seen = self._up_to_each_hit(found, cluster, len(weight)) @ weight
        true = self._up_to_each_hit(found, cluster, len(weight), self.hit) @ weight
        targets = np.bincount(cluster, minlength=len(weight)) @ weight
        precision = true / np.maximum(seen, 1)
        envelope = np.maximum.accumulate(precision[::-1])[::-1]  # precision only peaks where a target is found
        reached = np.searchsorted(_RECALLS, true / targets, side="right")
        result: NDArray[np.float64] = (envelope * np.diff(reached, axis=0, prepend=0)).sum(0) / len(_RECALLS)
        return result

    def _up_to_each_hit(
        self,
        found: NDArray[np.int64],
        cluster: NDArray[np.int64],
        clusters: int,
        weight: NDArray[np.bool_] | None = None,
    ) -> NDArray[np.float64]:
        """(H, C): detections of each cluster (weighted) ranked no lower than each of the H hits."""
        before = np.searchsorted(found, np.arange(found[-1] + 1))
        cell = before * clusters + cluster[self.frame[: found[-1] + 1]]
        weights = None if weight is None else weight[: found[-1] + 1].astype(np.float64)
        table = np.bincount(cell, weights, minlength=len(found) * clusters)
        return table.reshape(len(found), clusters).cumsum(0).astype(np.float64)


def interval(resampled: NDArray[np.float64]) -> tuple[float, float]:
    """The central 95 % of resampled values."""
    low, high = np.quantile(resampled, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def box_overlaps(boxes: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Intersection over union of (M, 4) xyxy boxes with one (4,) box: (M,).

    Computed from corners and sides as COCO's tools do, so that an overlap on the edge of 0.5 rounds as theirs.
    """
    sides, truth_sides = boxes[:, 2:] - boxes[:, :2], truth[2:] - truth[:2]
    ends = np.minimum(boxes[:, :2] + sides, truth[:2] + truth_sides)
    shared = np.clip(ends - np.maximum(boxes[:, :2], truth[:2]), 0, None).prod(1)
    return shared / np.maximum(sides.prod(1) + truth_sides.prod() - shared, 1e-12)


def best_score(sample: Sample) -> float:
    """The highest score of a detection that finds the target; 0 where none does."""
    on_target = box_overlaps(sample.boxes, sample.truth) >= IOU_THRESHOLD
    return float(sample.scores[on_target].max(initial=0.0))
