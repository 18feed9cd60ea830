"""Clips in the contract: where cameras and vehicles are, what is refused, and that still views stay what they were."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rauca_core.contract import Clips, Frame, Plan, RaucaError, balanced_frames, planned_frames
from rauca_core.contract.clips import MANOEUVRES, NEAREST_M, Spot, Street, clip_name, clips_asked, moves
from rauca_core.contract.schema import Fields
from rauca_core.contract.viewpoints import driven
from tests.contract.samples import PLAN, a_frame

CLIPS = Clips(MANOEUVRES, 11, 8.0, 10.0, 0.01)
BENT = Street(np.array([[0.0, -1, 0, 5], [1, 0, 0, 7], [0, 0, 1, 0], [0, 0, 0, 1]]), 0.01)


def way(name: str, which: int, clips: Clips = CLIPS) -> np.ndarray:
    """(F, 2) along and aside of camera (0) or vehicle (1)."""
    first = MANOEUVRES.index(name) * clips.frames
    spots = [moves(clips, first + frame)[which] for frame in range(clips.frames)]
    return np.array([(spot.along, spot.aside) for spot in spots])


@pytest.mark.parametrize("name", MANOEUVRES)
def test_the_camera_drives_at_the_stated_speed(name):
    steps = np.diff(way(name, 0), axis=0)
    np.testing.assert_allclose(steps, [[8.0 / 10.0, 0.0]] * 10, atol=1e-12)


def test_each_manoeuvre_is_what_it_is_called():
    assert way("approach", 1).any() is np.False_  # the vehicle stands
    assert way("approach", 0)[-1, 0] == -NEAREST_M
    assert len(set((way("following", 1) - way("following", 0))[:, 0].round(9))) == 1
    ahead = (way("overtaken", 1) - way("overtaken", 0))[:, 0]
    assert (np.diff(ahead) > 0).all()
    assert np.ptp(way("crossing", 1)[:, 0]) == 0 < np.ptp(way("crossing", 1)[:, 1])
    aside = way("cut-in", 1, replace(CLIPS, frames=41))[:, 1]
    assert aside[0] == pytest.approx(3.2) and aside[-1] == 0.0  # noqa: PT018 - one change of lanes
    assert (way("passing", 0)[:, 1] == 3.2).all()


def test_a_lane_that_bends_is_followed():
    whole = BENT.at(Spot(along=math.pi / 2 / 0.01))  # a quarter of its circle
    np.testing.assert_allclose(whole[:3, 3], [5 - 100, 7 + 100, 0], atol=1e-9)
    np.testing.assert_allclose(whole[:3, 0], [-1, 0, 0], atol=1e-9)


def test_what_is_seen_is_told_from_the_vehicle():
    plan = replace(PLAN, clips=CLIPS)
    seen, pose = driven(plan, CLIPS, CLIPS.frames - 1, BENT, np.array([0.0, 0.0, 0.7]))
    assert seen.azimuth_deg == pytest.approx(180, abs=3)  # from behind, on a bend
    assert seen.distance_m == pytest.approx(NEAREST_M, abs=0.1)
    pixel, depth = seen.camera.project((pose @ [0, 0, 0.7, 1])[None, :3])
    assert depth[0] > 0
    assert abs(pixel[0] - plan.size / 2).max() < plan.size / 2


def test_frames_of_clips_are_frames_of_the_plan():
    plan = replace(PLAN, clips=CLIPS, locations=2)
    assert plan.views == 66
    assert len(planned_frames(plan)) == 2 * 66 * len(plan.weathers)
    assert Plan.from_json(Fields(plan.to_json(), "plan")) == plan
    assert "clips" not in PLAN.to_json()
    assert "readout_s" not in plan.to_json()["clips"]
    rolling = replace(plan, clips=replace(CLIPS, readout_s=0.02))
    assert Plan.from_json(Fields(rolling.to_json(), "plan")) == rolling != plan
    assert clip_name(CLIPS, 1, 12, "day") == "L01-overtaken-day"
    assert CLIPS.at(12) == ("overtaken", 0.1)
    with pytest.raises(RaucaError, match="a part of a clip is no clip"):
        balanced_frames(plan, 4)


def test_a_frame_says_its_clip_and_a_still_says_nothing():
    frame = a_frame(clip="L00-approach-day", time_s=0.3)
    again = Frame.from_json(Fields(frame.to_json(), "frame"))
    assert (again.clip, again.time_s) == ("L00-approach-day", 0.3)
    assert {"clip", "time_s", "composed"}.isdisjoint(a_frame().to_json())


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (("approach", 1, 10.0, 15.0, 0.0), "a clip of one frame shows no motion"),
        (("approach", 9, 10.0, 15.0, 0.1), "does not close between frames"),
        (("approach", 9, 60.0, 15.0, 0.05), "60 m/s is 3 m while a frame is exposed"),
        (("approach", 9, 10.0, 15.0, 0.0, 0.1), "a readout of 0.1 s is not done when the next frame begins"),
        (("approach", 9, 10.0, 15.0, 0.0, -0.1), "readout_s must be between 0 and 10"),
        (("approach", 9, 12.0, 15.0, 0.01, 0.04), "12 m/s is 0.6 m while a frame is exposed"),
        (("approach,fly", 9, 10.0, 15.0, 0.0), "fly: clips are any of approach, overtaken"),
        (("approach,approach", 9, 10.0, 15.0, 0.0), "none, or one twice"),
    ],
)
def test_mistakes_are_one_line(asked, told):
    with pytest.raises(RaucaError, match=told) as error:
        clips_asked(*asked)
    assert "\n" not in str(error.value)
