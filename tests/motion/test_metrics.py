"""HOTA, changes of identity and breaks against trackeval, on random tracks."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.motion.metrics import follow, hota, overlap
from rauca_core.motion.tracks import Boxes


def random_clip(seed: int, empty: bool, frames: int = 30) -> tuple[list[Boxes], list[Boxes]]:
    """Five things on straight ways; a tracker that misses, swaps, invents and shakes."""
    rng = np.random.default_rng(seed)
    start, speed = rng.uniform(0, 60, (5, 2)), rng.uniform(-2, 2, (5, 2))
    names = np.arange(5)
    truth, tracks = [], []
    for frame in range(frames):
        at = start + frame * speed
        boxes = np.concatenate([at, at + 20], 1)
        there = rng.random(5) < 0.9
        truth.append(Boxes(boxes[there], np.arange(5)[there] + 3))
        if rng.random() < 0.2:
            names = rng.permutation(8)[:5]
        found = rng.random(5) < 0.7
        if empty and rng.random() < 0.15:
            found[:] = False
        elif not empty:
            found[rng.integers(5)] = True
        shaken = boxes[found] + rng.normal(0, 2.5, (int(found.sum()), 4))
        ids = names[found] + 1
        if rng.random() < 0.3 and found.any():
            stray = rng.uniform(0, 60, 2)
            shaken, ids = np.vstack([shaken, [*stray, *(stray + 15)]]), np.append(ids, 50 + frame)
        tracks.append(Boxes(shaken, ids))
    return truth, tracks


def as_trackeval(truth: list[Boxes], tracks: list[Boxes]) -> dict[str, object]:
    def numbered(frames: list[Boxes]) -> tuple[list[np.ndarray], int]:
        ids = sorted({int(i) for boxes in frames for i in boxes.values})
        return [np.array([ids.index(int(i)) for i in boxes.values], int) for boxes in frames], len(ids)

    (gt, gt_count), (pr, pr_count) = numbered(truth), numbered(tracks)
    return {
        "gt_ids": gt, "tracker_ids": pr, "num_gt_ids": gt_count, "num_tracker_ids": pr_count,
        "num_gt_dets": sum(map(len, gt)), "num_tracker_dets": sum(map(len, pr)), "num_timesteps": len(truth),
        "similarity_scores": [overlap(t.xyxy, p.xyxy) for t, p in zip(truth, tracks, strict=True)],
    }  # fmt: skip


@pytest.mark.parametrize("empty", [False, True])
@pytest.mark.parametrize("seed", range(12))
def test_figures_are_those_of_trackeval(seed, empty):
    trackeval = pytest.importorskip("trackeval")
    truth, tracks = random_clip(seed, empty)
    data = as_trackeval(truth, tracks)
    theirs, ours = trackeval.metrics.HOTA().eval_sequence(data), hota(truth, tracks)
    assert ours.hota == pytest.approx(theirs["HOTA"].mean(), abs=1e-12)
    assert ours.detection == pytest.approx(theirs["DetA"].mean(), abs=1e-12)
    assert ours.association == pytest.approx(theirs["AssA"].mean(), abs=1e-12)
    assert 0.1 < ours.hota < 0.9
    clear = trackeval.metrics.CLEAR({"THRESHOLD": 0.5, "PRINT_CONFIG": False}).eval_sequence(data)
    ways = follow(truth, tracks)
    assert sum(way.switches for way in ways.values()) == clear["IDSW"] > 0
    assert sum(int((way.track > 0).sum()) for way in ways.values()) == clear["CLR_TP"]
    breaks = sum(way.breaks for way in ways.values())
    assert breaks == clear["Frag"] if not empty else breaks >= clear["Frag"]


def test_a_tracker_that_says_nothing_breaks_a_track():
    box = np.array([[0.0, 0.0, 10.0, 10.0]])
    truth = [Boxes(box, np.array([1]))] * 5
    nothing = Boxes(np.zeros((0, 4)), np.zeros(0, np.int64))
    has = Boxes(box, np.array([7]))
    way = follow(truth, [has, nothing, has, has, Boxes(box, np.array([8]))])[1]
    assert (way.breaks, way.switches) == (1, 1)
    assert hota(truth, [nothing] * 5).hota == 0.0
    assert hota(truth, [has] * 5).hota == pytest.approx(1.0)
