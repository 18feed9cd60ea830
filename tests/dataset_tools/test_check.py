"""`rauca dataset check`: a whole data set passes, and whatever is wrong is found and named."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rauca_core.contract import Dataset, LedgerEntry, RaucaError, append_entry, load_frame, load_passes, save_frame
from rauca_core.contract.color import srgb_to_linear
from rauca_core.contract.frame import FramePasses
from rauca_core.dataset_tools import CheckResult, check_dataset
from rauca_core.runtime.images import read_image


def told(result: CheckResult) -> list[str]:
    return [str(finding) for finding in result.findings]


def stored(dataset: Dataset, frame_id: str) -> FramePasses:
    """A finished frame's passes, to be spoilt and saved again with valid checksums."""
    folder = dataset.frame_folder(frame_id)
    maps = load_passes(folder)

    def unit(name: str) -> np.ndarray:
        return read_image(folder / name).astype(np.float32) / 255

    check = folder / "check.png"
    return FramePasses(
        srgb_to_linear(unit("image.png")), unit("vehicle.png"), unit("paint.png"),
        maps["distance"].astype(np.float32),
        maps["A"].astype(np.float32), maps["B"].astype(np.float32), read_image(folder / "semantic.png").copy(),
        read_image(folder / "instances.png").copy(), srgb_to_linear(unit("check.png")) if check.is_file() else None,
    )  # fmt: skip


def test_a_whole_data_set_has_no_findings(mini):
    moves = []
    result = check_dataset(mini.folder, progress=moves.append)
    assert told(result) == []
    assert [(m.done, m.total) for m in moves] == [(i, 4) for i in range(5)]
    assert {name: dict(w.counts) for name, w in result.weathers.items()} == {
        "day": {"planned": 2, "done": 2},
        "dusk": {"planned": 2, "done": 2},
    }
    checked = sum(frame.check_srgb is not None for frame in mini.frames())
    assert sum(w.checked for w in result.weathers.values()) == checked > 0
    assert all(w.psnr_db > 40 for w in result.weathers.values() if w.checked)
    json.dumps(result.to_json())


def test_every_flipped_byte_is_found(mini):
    """Three random bytes of every file, one bit each, one at a time; of the ledger, a log, only its words matter."""

    def found(folder: Path) -> bool:
        try:
            return bool(told(check_dataset(folder)))
        except RaucaError as error:  # the plan itself
            return "dataset.json" in str(error)

    rng = np.random.default_rng(5)
    files = [p for p in sorted(mini.folder.rglob("*")) if p.is_file()]
    frame = mini.frames()[0].id
    chosen = [p for p in files if ("frames" not in p.parts or p.parent.name == frame) and p.suffix != ".jsonl"]
    assert {p.suffix for p in chosen} == {".json", ".png", ".npz", ""}
    for path in chosen:
        whole = path.read_bytes()
        for place in rng.integers(0, len(whole), 3).tolist():
            spoilt = bytearray(whole)
            spoilt[place] ^= 1 << int(rng.integers(8))
            path.write_bytes(spoilt)
            assert found(mini.folder), f"{path.name}, byte {place}"
        path.write_bytes(whole)
    assert told(check_dataset(mini.folder)) == []


def test_a_changed_plan_is_found(mini):
    path = mini.folder / "dataset.json"
    path.write_text(path.read_text().replace('"mini"', '"mino"'))
    assert told(check_dataset(mini.folder))[0].startswith("dataset.json: its bytes are not those that were written")


@pytest.mark.parametrize(
    ("line", "what"),
    [
        (b'{"frame": "L00-V000-day", "state": "d\xffne"}\n', "line 5 is damaged"),
        (b'["frame"]\n', "line 5 is damaged"),
        (b'{"frame": "L00-V000-day", "state": "lost"}\n', "line 5 is damaged (state must be one of done,"),
        (b'{"frame": "L07", "state": "done"}\n', "line 5 names 'L07', which is no frame of the plan"),
        (b'{"frame": "L0', "its last line is cut off"),
    ],
)
def test_bad_ledger_lines_are_told_by_number(mini, line, what):
    with (mini.folder / "ledger.jsonl").open("ab") as ledger:
        ledger.write(line)
    assert any(f"ledger.jsonl: {what}" in text for text in told(check_dataset(mini.folder)))


@pytest.mark.parametrize(
    ("spoil", "what"),
    [
        (lambda f, p: {"box_xyxy": (f.box_xyxy[0] + 1, *f.box_xyxy[1:])}, "frame.json: box_xyxy"),
        (lambda f, p: p.A.__setitem__((3, 3, 0), np.nan), "passes.npz: A holds NaN"),
        (lambda f, p: p.A.__setitem__((0, 0), 0.5), "passes.npz: A is not zero at 1 pixels without paint"),
        (lambda f, p: p.paint.__setitem__((0, 0), 1), "paint.png: 1 pixels have more paint than vehicle"),
        (lambda f, p: p.semantic.__setitem__((0, 0), 99), "semantic.png: class 99 does not exist"),
        (
            lambda f, p: p.instances.__setitem__(np.s_[40:, 40:], 3),
            "frame.json: instances are not those of instances.png",
        ),
        (lambda f, p: p.image_linear[10:].__imul__(0.5), "image.png: .* pixels are not what A and B give"),
        (lambda f, p: p.image_linear.fill(0), "image.png: every pixel has the value 0"),
        (
            lambda f, p: {"camera": replace(f.camera, t=f.camera.t + np.array([0.1, 0, 0]))},
            "frame.json: the camera does not stand where",
        ),
        (
            lambda f, p: {"azimuth_deg": f.azimuth_deg + 20},
            "frame.json: azimuth or elevation lies outside view 0",
        ),
        (lambda f, p: {"visible": 0.4}, "frame.json: visible is 0.400, below the plan's limit of 0.5"),
        (
            lambda f, p: setattr(p, "semantic", p.semantic[:-1]),
            r"semantic.png: has shape \(47, 48\), expected \(48, 48\)",
        ),
        (lambda f, p: p.distance.fill(np.nan), "passes.npz: distance holds values that are no distance"),
    ],
)
def test_what_valid_files_may_not_say_is_found(mini, spoil, what):
    """Frames written by a faulty job: every checksum is right. ``spoil`` changes passes, or returns the frame's."""
    frame = mini.frames()[0]
    passes = stored(mini, frame.id)
    changed = spoil(frame, passes)
    frame = replace(frame, **changed) if isinstance(changed, dict) else frame
    save_frame(mini.frame_folder(frame.id), frame, passes)
    texts = told(check_dataset(mini.folder))
    assert any(re.match(f"frames/{frame.id}/{what}", text) for text in texts), texts
    assert all("; check with --remove-damaged and run" in text for text in texts)


def test_another_vehicle_of_the_same_class_is_found(mini):
    frame = mini.frames()[0]
    (truck,) = frame.instances
    second = replace(frame, instances=(replace(truck, category="car"),))
    save_frame(mini.frame_folder(frame.id), second, stored(mini, frame.id))
    (text,) = told(check_dataset(mini.folder))
    assert text.startswith(f"frames/{frame.id}/frame.json: another vehicle is a car, as the data set's own is")
    assert text.endswith("make the data set again in another folder")


def test_a_color_that_the_light_maps_do_not_predict_fails_its_weather(mini):
    frame = next(f for f in mini.frames() if f.check_srgb is not None)
    passes = stored(mini, frame.id)
    passes.check_linear = passes.check_linear + np.float32(0.2)
    save_frame(mini.frame_folder(frame.id), frame, passes)
    result = check_dataset(mini.folder)
    assert result.weathers[frame.weather.name].psnr_db < 30
    assert any(f"in weather {frame.weather.name}, below 30" in text for text in told(result))
    assert told(check_dataset(mini.folder, min_psnr_db=0)) == []


def test_missing_occluded_and_quarantined_frames_are_counted(mini):
    first, second, third, _ = mini.frames()
    for frame in (first, second, third):
        shutil.rmtree(mini.frame_folder(frame.id))
    append_entry(mini.folder, LedgerEntry(first.id, "occluded", visible=0.2))
    append_entry(mini.folder, LedgerEntry(second.id, "quarantined", reason="no memory"))
    result = check_dataset(mini.folder)
    counts = sum((w.counts for w in result.weathers.values()), start=type(result.weathers["day"].counts)())
    assert counts == {"planned": 4, "done": 1, "occluded": 1, "quarantined": 1, "missing": 1}
    texts = told(result)
    assert f"frames/{second.id}: failed twice: no memory; run the same" in "\n".join(texts)
    assert any("1 of 4 frames are not rendered" in text for text in texts)
    assert any(f"frames/{third.id}: the ledger says done, its folder is gone" in text for text in texts)
    assert not any("not rendered" in text for text in told(check_dataset(mini.folder, unfinished=True)))


def test_what_does_not_belong_is_named(mini):
    (mini.folder / "frames" / ".partial-x").mkdir()
    (mini.folder / ".partial-y").write_text("half a plan")
    (mini.folder / "frames" / "L99").mkdir()
    (mini.frame_folder(mini.frames()[0].id) / "notes.txt").write_text("x")
    (mini.frame_folder(mini.frames()[1].id) / "paint.png").unlink()
    texts = "\n".join(told(check_dataset(mini.folder)))
    assert "frames/.partial-x: left by a killed job" in texts
    assert ".partial-y: left by a killed job" in texts.splitlines()[0]
    assert "frames/L99: is no frame of the plan; remove it" in texts
    assert "/notes.txt: is not among the files" in texts
    assert "/paint.png: missing" in texts


def test_frames_of_another_vehicle_are_told(mini, box_vehicle, tmp_path):
    box_vehicle.positions *= 1.01
    box_vehicle.save(Path(mini.folder) / "vehicle")
    texts = "\n".join(told(check_dataset(mini.folder)))
    assert "vehicle/mesh.npz: its bytes are not those that were written" in texts
    assert load_frame(mini.frame_folder(mini.frames()[0].id)).id in texts  # the cameras no longer stand right
