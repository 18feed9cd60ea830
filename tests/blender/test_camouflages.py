"""Renders in camouflage: only the surroundings of the vehicle are rendered again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.agreement import measure_agreement
from blender_addon.core import files
from blender_addon.scene.camouflages import MARGIN, read_paintwork, render_camouflages
from blender_addon.scene.frame import render_chunk
from blender_addon.scene.render import Crop
from rauca_core.attack import random_camouflage
from rauca_core.contract import Dataset, Quality, Weather, claim_folder, planned_frames
from rauca_core.runtime.images import read_image
from tests.hostile.nasty import DEEP


@pytest.fixture
def painted(session, box_vehicle, tmp_path):
    """Makes a data set in a weather that the session renders, and a paint for it."""

    def make(weather, size, samples, frames=None):
        session.plan = replace(session.plan, size=size, quality=Quality(samples), weathers=(weather,))
        claim_folder(tmp_path / "set", session.plan)
        box_vehicle.save(tmp_path / "set" / "vehicle")
        render_chunk(session, tmp_path / "set", planned_frames(session.plan)[:frames], lambda news: None)
        random_camouflage(tmp_path / "random.json", box_vehicle, size=64, seed=2, cell=4)
        return Dataset(tmp_path / "set"), read_paintwork(tmp_path / "random.json", box_vehicle.atlas_id)

    return make


def progress(done, total, last):
    """Of renders: nobody looks."""


@pytest.mark.parametrize("weather", [Weather("day", 45), Weather("fog", 45, 60, 50)], ids=lambda w: w.name)
def test_predicted_and_rendered_camouflage_agree(session, painted, tmp_path, weather):
    """The core promise, end to end: taps and light maps predict what Cycles renders in a texture they never saw."""
    dataset, paintwork = painted(weather, 128, 16)
    render_camouflages(session, dataset, [paintwork], tmp_path / "renders", progress)
    found = measure_agreement(dataset, tmp_path / "random.json", tmp_path / "renders" / "random")
    assert len(found.frames) == 2
    assert found.mean_iou > 0.99
    assert found.inside_db > 32
    assert found.edge_db > 24


def test_a_part_and_the_data_sets_own_image_make_the_whole_frame(session, painted, tmp_path, monkeypatch):
    dataset, paintwork = painted(Weather("rain", 30, precipitation=60), 192, 8, frames=1)
    frame, asked = dataset.frames()[0], []
    monkeypatch.setattr(files, "require_space", lambda folder, needed: asked.append(needed))
    render_camouflages(session, dataset, [paintwork], tmp_path / "part", progress)
    plan, finer = session.plan, replace(session.plan.quality, adaptive_threshold=1e-6)
    session.plan = replace(plan, quality=finer)  # the same samples, but not the data set's settings: whole frames
    render_camouflages(session, dataset, [paintwork], tmp_path / "whole", progress)
    session.plan = plan

    part, whole = (read_image(tmp_path / name / "random" / f"{frame.id}.png") / 255.0 for name in ("part", "whole"))
    own = read_image(dataset.frame_folder(frame.id) / "image.png") / 255.0
    vehicle = read_image(dataset.frame_folder(frame.id) / "vehicle.png") > 0
    inside = np.zeros(vehicle.shape, bool)
    inside[Crop.around(vehicle, round(MARGIN * plan.size)).inside] = True
    assert 0.1 < inside.mean() < 0.9
    assert (part[~inside] == own[~inside]).all()
    assert np.abs(part - own)[vehicle].mean() > 0.05
    assert np.sqrt(np.square(part - whole).mean()) < 0.015

    render_camouflages(session, dataset, [paintwork], tmp_path / "part", progress)
    assert asked == [4 * plan.size**2] * 2 + [0]  # nothing where all is there
    stamp = (tmp_path / "part" / "random" / f"{frame.id}.png").stat().st_mtime_ns
    (tmp_path / "part" / "random" / "camouflage.json").write_bytes(DEEP)  # whose renders these are, no file tells
    render_camouflages(session, dataset, [paintwork], tmp_path / "part", progress)
    assert (tmp_path / "part" / "random" / f"{frame.id}.png").stat().st_mtime_ns > stamp
