"""Pictures of a data set show what its files say."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from rauca_core.contract import LedgerEntry, RaucaError, append_entry
from rauca_core.contract.semantics import CLASS_IDS, PALETTE
from rauca_core.dataset_tools import sheets as drawing
from rauca_core.dataset_tools import view_dataset
from rauca_core.dataset_tools.sheets import GAP, HEAD, LABEL, MARGIN, TILE, contact_sheet
from rauca_core.dataset_tools.stored import StoredFrame, targets_of
from rauca_core.dataset_tools.view import columns_of


def test_a_page_shows_sheet_and_overlays_without_loading_anything(mini, tmp_path):
    page = view_dataset(mini.folder, tmp_path / "out")
    text = page.read_text()
    overlays = sorted(p.stem for p in (tmp_path / "out" / "overlays").iterdir())
    assert overlays == sorted(frame.id for frame in mini.frames())
    assert text.count("data:image/jpeg;base64,") == 1 + len(overlays)
    assert "http" not in text
    assert "4 of 4" in text


def test_columns_go_through_the_places(mini):
    ring = mini.plan.ring
    one, many = replace(ring, azimuths_deg=(0.0,)), replace(ring, azimuths_deg=tuple(map(float, range(0, 360, 45))))
    assert columns_of(replace(mini.plan, ring=one, locations=3)) == [(0, 0), (1, 0), (2, 0)]
    assert columns_of(replace(mini.plan, ring=many, locations=2)) == [(0, 1), (1, 3), (0, 5), (1, 7)]
    assert columns_of(replace(mini.plan, ring=many, locations=1), [6, 2]) == [(0, 6), (0, 2)]


def test_each_tile_of_the_contact_sheet_is_its_frame(mini, tmp_path):
    gone = mini.frames()[3]
    shutil.rmtree(mini.frame_folder(gone.id))
    append_entry(mini.folder, LedgerEntry(gone.id, "occluded", visible=0.1))
    page = view_dataset(mini.folder, tmp_path / "out", frames=[mini.frames()[0].id])
    sheet = np.asarray(Image.open(tmp_path / "out" / "contact-sheet.jpg")).astype(int)
    left, head = MARGIN + LABEL, HEAD
    for stored in StoredFrame.all_of(mini):
        row, column = ("day", "dusk").index(stored.frame.weather.name), stored.frame.view
        top, start = head + row * (TILE + GAP), left + column * (TILE + GAP)
        tile = sheet[top : top + TILE, start : start + TILE]
        assert np.abs(tile - np.asarray(drawing.enlarged(stored.image(), TILE)).astype(int)).mean() < 3
    hole = sheet[head + TILE + GAP + 9, left + TILE + GAP + 9]
    assert np.abs(hole - [0xF0, 0xF2, 0xF5]).max() < 5
    assert "1 with less than 50 %" in page.read_text()
    assert len(list((tmp_path / "out" / "overlays").iterdir())) == 1


def test_boxes_are_drawn_where_they_are_and_classes_in_their_colors(mini):
    stored = next(s for s in StoredFrame.all_of(mini) if s.frame.instances)
    side = 4 * stored.frame.camera.width
    targets = list(targets_of(stored, "car"))
    assert [t.category for t in targets] == ["car", "truck"]
    picture = np.asarray(drawing.with_boxes(stored, targets, side))
    left, top, _, bottom = (int(4 * v) for v in stored.frame.box_xyxy)
    assert (picture[(top + bottom) // 2, left] == [0x2E, 0xE6, 0xA8]).all()
    left, top, right, bottom = (int(4 * v) for v in targets[1].box_xyxy)
    assert (picture[bottom - 1, (left + right) // 2] == [0xFF, 0xB3, 0x00]).all()

    classes = np.asarray(drawing.with_classes(stored, side)).astype(float)
    semantic = stored.image("semantic.png").repeat(4, 0).repeat(4, 1)
    for name in ("paint", "sky", "terrain"):
        shown = np.median(classes[semantic == CLASS_IDS[name]], axis=0)
        distances = np.linalg.norm(PALETTE - shown, axis=1)
        tinted = shown - shown.mean()
        wanted = PALETTE[CLASS_IDS[name]] - PALETTE[CLASS_IDS[name]].mean()
        assert tinted @ wanted > 0.9 * np.linalg.norm(tinted) * np.linalg.norm(wanted), (name, distances.argmin())


def test_frames_and_views_that_are_not_there_are_named(mini, tmp_path):
    with pytest.raises(RaucaError, match="no finished frame 'L9'; one is 'L00"):
        view_dataset(mini.folder, tmp_path / "out", frames=["L9"])
    with pytest.raises(RaucaError, match="has views 0 to 1, not 2"):
        view_dataset(mini.folder, tmp_path / "out", views=[2])
    assert not (tmp_path / "out").exists()


def test_many_weathers_stand_in_blocks(mini):
    stored = StoredFrame.all_of(mini)[0]
    sheet = contact_sheet("sixteen", {f"weather-{i}": [stored, None] for i in range(16)}, ["a", "b"], tile=96)
    assert sheet.width == 3 * MARGIN + 2 * (LABEL + 2 * 96 + GAP)
    assert sheet.height == HEAD + 8 * (96 + GAP) - GAP + MARGIN
    pixels = np.asarray(sheet)
    last = pixels[HEAD + 7 * (96 + GAP) :][:96, MARGIN + 2 * LABEL + 2 * 96 + GAP + MARGIN :][:, :96]
    assert np.array_equal(last, np.asarray(drawing.enlarged(stored.image(), 96)))
