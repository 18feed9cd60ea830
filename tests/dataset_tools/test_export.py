"""What other tools read back is what the frames say."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest

from rauca_core.contract import RaucaError, load_passes
from rauca_core.contract.color import TEST, linear_to_srgb, recolor, to_bytes
from rauca_core.dataset_tools import export_dataset, recolor_dataset, recoloring
from rauca_core.dataset_tools.export import encode_mask
from rauca_core.dataset_tools.stored import StoredFrame
from rauca_core.runtime.images import read_image
from tests.hostile.nasty import DEEP


def test_coco_tools_read_the_frames_own_boxes_and_masks(mini, tmp_path):
    faster_coco_eval = pytest.importorskip("faster_coco_eval")
    moves = []
    assert (
        export_dataset(mini.folder, "coco", tmp_path / "coco", moves.append) == 6
    )  # the box four times, the truck twice
    assert [(m.done, m.total) for m in moves] == [(i, 4) for i in range(1, 5)]
    coco = faster_coco_eval.COCO(str(tmp_path / "coco" / "annotations.json"))
    by_name = {image["file_name"]: image for image in coco.imgs.values()}
    names = {c["id"]: c["name"] for c in coco.cats.values()}
    for stored in StoredFrame.all_of(mini):
        file = f"images/{stored.frame.id}.png"
        assert np.array_equal(read_image(tmp_path / "coco" / file), stored.image())
        found = coco.imgToAnns[by_name[file]["id"]]
        car = next(a for a in found if names[a["category_id"]] == "car")
        assert car["category_id"] == 3  # COCO's own number
        left, top, width, height = car["bbox"]
        assert (left, top, left + width, top + height) == stored.frame.box_xyxy
        assert np.array_equal(coco.annToMask(car).astype(bool), stored.image("vehicle.png") >= 128)
        assert car["area"] == (stored.image("vehicle.png") >= 128).sum()
        others = [a for a in found if a is not car]
        assert [names[a["category_id"]] for a in others] == [i.category for i in stored.frame.instances]
        for annotation, instance in zip(others, stored.frame.instances, strict=True):
            assert annotation["bbox"][:2] == list(instance.box_xyxy[:2])
            assert np.array_equal(coco.annToMask(annotation).astype(bool), stored.image("instances.png") == instance.id)


def test_coco_ground_truth_scores_itself_perfectly(mini, tmp_path):
    faster_coco_eval = pytest.importorskip("faster_coco_eval")
    export_dataset(mini.folder, "coco", tmp_path / "coco")
    coco = faster_coco_eval.COCO(str(tmp_path / "coco" / "annotations.json"))
    detections = [
        {"image_id": a["image_id"], "category_id": a["category_id"], "bbox": a["bbox"], "score": 1.0}
        for a in coco.anns.values()
    ]
    scores = faster_coco_eval.COCOeval_faster(coco, coco.loadRes(detections), "bbox")
    scores.evaluate()
    scores.accumulate()
    scores.summarize()
    assert scores.stats[0] == pytest.approx(1.0)


def test_yolo_boxes_are_the_frames(mini, tmp_path):
    export_dataset(mini.folder, "yolo", tmp_path / "yolo")
    lines = (tmp_path / "yolo" / "data.yaml").read_text().splitlines()
    names = dict(line.strip().split(": ") for line in lines if line.startswith("  "))
    assert names["2"] == "car"  # as in networks trained on COCO
    assert names["7"] == "truck"
    for frame in mini.frames():
        rows = (tmp_path / "yolo" / "labels" / f"{frame.id}.txt").read_text().splitlines()
        expected = [("car", frame.box_xyxy), *((i.category, i.box_xyxy) for i in frame.instances)]
        assert len(rows) == len(expected)
        for row, (category, box) in zip(rows, expected, strict=True):
            number, *values = row.split()
            x, y, width, height = np.array(values, float) * frame.camera.width
            assert names[number] == category
            assert (x - width / 2, y - height / 2, x + width / 2, y + height / 2) == pytest.approx(box, abs=1e-3)
        assert (tmp_path / "yolo" / "images" / f"{frame.id}.png").is_file()


@pytest.mark.parametrize("seed", range(4))
def test_run_lengths_are_what_coco_reads(seed):
    coco = pytest.importorskip("pycocotools.mask", reason="pycocotools is part of the extra `dev`")
    mask = np.random.default_rng(seed).random((7, 5)) < (0.5, 0.9, 0.0, 1.0)[seed]
    rle = encode_mask(mask)
    assert sum(rle["counts"]) == mask.size
    assert np.array_equal(coco.decode(coco.frPyObjects(rle, *rle["size"])), mask)


def test_exports_that_cannot_be_are_refused(mini, tmp_path):
    with pytest.raises(RaucaError, match="format 'voc' is unknown; choose one of coco, yolo"):
        export_dataset(mini.folder, "voc", tmp_path / "x")
    for frame in mini.frames():
        (mini.frame_folder(frame.id) / "frame.json").unlink()
    with pytest.raises(RaucaError, match="no finished frame to export"):
        export_dataset(mini.folder, "coco", tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_recolored_files_are_the_affine_images_and_are_kept(mini, tmp_path):
    colors = TEST[:3]
    assert recolor_dataset(mini.folder, colors, tmp_path / "out") == 12
    frame = mini.frames()[1]
    maps = load_passes(mini.frame_folder(frame.id))
    for color in colors:
        path = tmp_path / "out" / bytes(color).hex() / f"{frame.id}.png"
        assert np.array_equal(read_image(path), to_bytes(linear_to_srgb(recolor(maps["A"], maps["B"], color))))
    path.unlink()
    moves = []
    assert recolor_dataset(mini.folder, colors, tmp_path / "out", moves.append) == 1
    assert moves[-1].done == moves[-1].total == 12


def test_recolored_files_of_another_data_set_are_written_anew(mini, tmp_path):
    colors, out = TEST[:2], tmp_path / "out"
    last, *frames = reversed(mini.frames())
    shutil.move(mini.frame_folder(last.id), tmp_path / "aside")
    assert recolor_dataset(mini.folder, colors, out) == 6
    shutil.move(tmp_path / "aside", mini.frame_folder(last.id))
    assert recolor_dataset(mini.folder, colors, out) == 2  # a data set that has grown keeps what there was

    folder = mini.frame_folder(frames[0].id)
    sums = (folder / "SHA256SUMS").read_text()
    (folder / "SHA256SUMS").write_text(re.sub(r"[0-9a-f]{8}(?=[0-9a-f]{56}  passes.npz)", "0" * 8, sums))
    shutil.rmtree(mini.frame_folder(last.id))
    assert recolor_dataset(mini.folder, colors, out) == 2
    assert sorted(path.stem for path in out.glob("*/*.png")) == sorted(2 * [frame.id for frame in frames])
    for note in out.glob("*/recolor.json"):
        note.write_bytes(DEEP)  # whose images these are, no file tells
    assert recolor_dataset(mini.folder, colors, out) == 6


def test_room_is_asked_for_what_is_missing_alone(mini, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(recoloring, "require_space", lambda folder, needed: asked.append(needed))
    for _ in range(2):
        recolor_dataset(mini.folder, TEST[:2], tmp_path / "out")
    assert asked == [3 * mini.plan.size**2 * 8, 0]
