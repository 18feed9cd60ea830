"""The library's trackers on made-up detections."""

from __future__ import annotations

import numpy as np
import pytest

from rauca_core.contract import RaucaError
from rauca_core.motion import tracks
from rauca_core.motion.tracks import Boxes, track

pytest.importorskip("trackers")


def drifting(scores: list[float]) -> list[Boxes]:
    """A car that moves two pixels a frame; a score of 0: not found."""
    at = [np.array([[10.0 + 2 * i, 20.0, 60.0 + 2 * i, 55.0]]) for i in range(len(scores))]
    return [Boxes(box[: 1 if s else 0], np.array([s] if s else [])) for box, s in zip(at, scores, strict=True)]


@pytest.mark.parametrize("name", tracks.TRACKERS)
def test_a_car_keeps_its_track_over_a_short_gap(name):
    told = track(drifting([0.9] * 6 + [0.0] * 3 + [0.9] * 4), 20.0, name)
    assert [len(boxes) for boxes in told[-4:]] == [1] * 4
    assert {int(i) for boxes in told for i in boxes.values} == {1}
    assert [len(boxes) for boxes in told[6:9]] == [0] * 3
    np.testing.assert_allclose(told[5].xyxy, drifting([0.9] * 6)[5].xyxy)


def test_bytetrack_goes_on_with_faint_detections_and_sort_does_not():
    faint = drifting([0.9] * 5 + [0.2] * 3)
    assert len(track(faint, 20.0, "bytetrack")[-1]) == 1
    assert len(track(faint, 20.0, "sort")[-1]) == 0
    assert not any(len(boxes) for boxes in track(drifting([0.2] * 8), 20.0, "bytetrack"))


def test_ids_do_not_depend_on_what_was_tracked_before():
    first, second = (track(drifting([0.9] * 5), 20.0) for _ in range(2))
    assert [b.values.tolist() for b in first] == [b.values.tolist() for b in second]


def test_mistakes_are_one_line(monkeypatch):
    with pytest.raises(RaucaError, match="--tracker kalman: must be one of bytetrack, sort"):
        track(drifting([0.9]), 20.0, "kalman")
    monkeypatch.setattr(tracks, "NEEDED", ("no_such_package",))
    with pytest.raises(RaucaError, match="pip install --no-deps trackers"):
        track(drifting([0.9]), 20.0)
