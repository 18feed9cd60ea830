"""A study of clips from drawn cars: figures, page and animation, without a renderer."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rauca_core.contract import Clips, Dataset, RaucaError, claim_folder, load_frame
from rauca_core.contract.clips import clip_name
from rauca_core.contract.files import write_json, write_sums
from rauca_core.report import write_clips
from rauca_core.study import driven
from rauca_core.study.candidates import NORMAL
from rauca_core.study.detecting import Pictures, detect_in
from rauca_core.study.detection_cache import DetectionCache, DetectionSettings
from rauca_core.study.scores import tabulate
from rauca_core.study.study import Entry, Study
from tests.study.conftest import Scene

pytest.importorskip("trackers")
CLIPS = Clips(("approach", "passing"), 4, 5.0, 10.0)


def as_clips(scene: Scene) -> Dataset:
    """The drawn views as two clips in each weather: the same pictures, told to follow each other."""
    folder = scene.dataset.folder
    (folder / "dataset.json").unlink()
    claim_folder(folder, dataclasses.replace(scene.dataset.plan, clips=CLIPS))
    for frame in scene.dataset.frames():
        clip, time = clip_name(CLIPS, 0, frame.view, frame.weather.name), CLIPS.at(frame.view)[1]
        told = dataclasses.replace(frame, clip=clip, time_s=time, distance_m=20.0 - frame.view % 4)
        home = scene.dataset.frame_folder(frame.id)
        write_json(home / "frame.json", told.to_json())
        write_sums(home, [path.name for path in home.iterdir() if path.name != "SHA256SUMS"])
        assert load_frame(home).clip == clip
    return Dataset(folder)


@pytest.fixture
def study(scene: Scene, detectors, tmp_path: Path) -> Study:
    data = as_clips(scene)
    shown = [frame for frame in data.frames() if frame.box_xyxy is not None]
    pictures = {
        NORMAL: Pictures.of(shown, [data.frame_folder(frame.id) / "image.png" for frame in shown]),
        "noise": Pictures.of(shown, [scene.noise / f"{frame.id}.png" for frame in shown]),
    }
    caches = {
        paint: {
            one.name: DetectionCache(tmp_path / "found", one.name, one.fingerprint, DetectionSettings())
            for one in detectors
        }
        for paint in pictures
    }
    for paint, some in pictures.items():
        detect_in(some, [(one, caches[paint][one.name]) for one in detectors], "cpu")
    out = tmp_path / "study"
    results = tabulate(data, pictures, caches, out)
    entry = Entry("drawn", "none", "box", "car", results, out, data.folder)
    return Study("rauca evaluate", (entry,))


def test_a_study_of_clips_says_what_warning_is_lost(study: Study, tmp_path: Path):
    assert driven.has_clips(study)
    drives = driven.measure_drives(study)
    assert {row.clips for row in drives.rows} == {6}
    plain = [row for row in drives.rows if row.paint == NORMAL]
    assert all((row.lost_m.value, row.lost_s.value) == (0.0, 0.0) for row in plain)
    for row in plain:  # drawn for these detectors
        assert row.hota > 0.2
    painted = [row for row in drives.rows if row.paint == "noise"]
    assert max(row.lost_s.value for row in painted) > 0
    for row in painted:
        assert row.lost_s.low <= row.lost_s.value <= row.lost_s.high
        one = [clip for clip in drives.clips if (clip.paint, clip.detector) == ("noise", row.detector)]
        other = [clip for clip in drives.clips if (clip.paint, clip.detector) == (NORMAL, row.detector)]
        late = np.mean([a.late_s - b.late_s for a, b in zip(one, other, strict=True)])
        assert row.lost_s.value == pytest.approx(late)
    kept = json.loads(driven.save_drives(tmp_path, drives).read_text())
    assert len(kept["clips"]) == 6 * 2 * 2

    page, *beside = write_clips(study, drives, tmp_path / "clips.html")
    told = page.read_text()
    assert "warning lost, m" in told and "data:image/webp" in told  # noqa: PT018
    film = Image.open(next(path for path in beside if path.suffix == ".webp"))
    assert (film.n_frames, film.size) == (CLIPS.frames, (640, 320))


def test_vehicles_have_rows_of_their_own_and_one_together(study: Study):
    (entry,) = study.entries
    drives = driven.measure_drives(Study("", (entry, dataclasses.replace(entry, vehicle="crate"))))
    assert [len(rows) for rows in driven.by_detector(drives).values()] == [2] * 4
    together = driven.over_vehicles(drives)
    assert together.clips == drives.clips
    alone = {(row.paint, row.detector): row for row in drives.rows if row.vehicle == "box"}
    assert {(row.paint, row.detector) for row in together.rows} == set(alone)
    for row in together.rows:  # both vehicles are the same one, so only what is counted doubles
        one = alone[row.paint, row.detector]
        assert row.vehicle == "box, crate"
        assert (row.clips, row.breaks) == (2 * one.clips, 2 * one.breaks)
        assert (row.ap, row.gap_s) == pytest.approx((one.ap, one.gap_s))
        assert row.lost_m.value == pytest.approx(one.lost_m.value)


def test_still_views_have_no_clips(scene: Scene, study: Study):
    stills = dataclasses.replace(study.entries[0], views=None)
    with pytest.raises(RaucaError, match="none of the views are clips"):
        driven.measure_drives(Study("", (stills,)))
