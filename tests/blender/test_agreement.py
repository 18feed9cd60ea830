"""The core promise, end to end: taps and light maps predict what Cycles renders in a texture they never saw."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rauca_core.attack import random_camouflage
from rauca_core.contract import Dataset, Quality, Weather, claim_folder, planned_frames
from rauca_core.study.agreement import measure_agreement


@pytest.mark.parametrize(("weather", "inside_db"), [(Weather("day", 45), 32.0), (Weather("fog", 45, 60, 50), 32.0)])
def test_predicted_and_rendered_camouflage_agree(session, box_vehicle, tmp_path, weather, inside_db):
    from blender_addon.scene.camouflages import read_paintwork, render_camouflages
    from blender_addon.scene.frame import render_chunk

    def ignore(done, total, last):
        pass

    session.plan = replace(session.plan, size=128, quality=Quality(16), weathers=(weather,))
    folder = tmp_path / "set"
    claim_folder(folder, session.plan)
    box_vehicle.save(folder / "vehicle")
    render_chunk(session, folder, planned_frames(session.plan), lambda news: None)
    random_camouflage(tmp_path / "random.json", box_vehicle, size=64, seed=2, cell=4)
    paintwork = read_paintwork(tmp_path / "random.json", box_vehicle.atlas_id)
    render_camouflages(session, Dataset(folder), [paintwork], tmp_path / "renders", ignore)

    found = measure_agreement(Dataset(folder), tmp_path / "random.json", tmp_path / "renders" / "random")
    assert len(found.frames) == 2
    assert found.mean_iou > 0.99
    assert found.inside_db > inside_db
    assert found.edge_db > 24
