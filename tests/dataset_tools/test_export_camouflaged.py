"""Frames in camouflages, exported beside the plain ones: the exact light's pictures, with the frames' own boxes."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rauca_core.attack import Renderer, load_paint
from rauca_core.contract import Camouflage, Dataset, RaucaError, load_passes, save_camouflage
from rauca_core.contract.color import linear_to_srgb, recolor, to_bytes
from rauca_core.contract.files import png_bytes, write_json
from rauca_core.dataset_tools import export, export_dataset
from rauca_core.dataset_tools.stored import StoredFrame
from rauca_core.runtime.images import read_image
from rauca_core.study.camouflaged import export_camouflaged

from .test_commands import rauca

RED = (200, 30, 60)


def camouflage(data: Dataset, path: Path, name: str, size: int = 64, atlas: str = "", color=RED) -> Path:
    """A plain one, in one color all over."""
    record = Camouflage(name, "box", atlas or data.plan.atlas_id, size, "own")
    save_camouflage(path, record, png_bytes(np.full((size, size, 3), color, np.uint8)))
    return path


@pytest.fixture
def red(mini: Dataset, tmp_path: Path) -> Path:
    return camouflage(mini, tmp_path / "red.json", "red")


def names_in(folder: Path) -> list[str]:
    return sorted(path.stem for path in folder.iterdir())


def test_every_frame_is_there_plain_and_in_each_camouflage(mini: Dataset, red: Path, tmp_path: Path) -> None:
    other = camouflage(mini, tmp_path / "blue.json", "blue", 32, color=(20, 40, 220))
    moves = []
    out = tmp_path / "yolo"
    assert export_camouflaged(mini.folder, [str(red), f"second={other}"], "yolo", out, moves.append) == 3 * 6
    frames = [frame.id for frame in mini.frames()]
    assert names_in(out / "images") == sorted(
        f"{frame}{label}" for frame in frames for label in ("", "--red", "--second")
    )
    assert names_in(out / "labels") == names_in(out / "images")
    for stored in StoredFrame.all_of(mini):
        plain = out / "images" / f"{stored.frame.id}.png"
        assert np.array_equal(read_image(plain), stored.image())
        maps, painted = load_passes(stored.folder), stored.image("paint.png") == 255
        expected = to_bytes(linear_to_srgb(recolor(maps["A"], maps["B"], RED))).astype(int)
        worn = read_image(plain.with_name(f"{stored.frame.id}--red.png")).astype(int)
        assert abs(worn - expected)[painted].mean() < 1  # one color: whatever texel a pixel reads, it is this one
        unpainted = stored.image("paint.png") == 0
        assert abs(worn - stored.image().astype(int))[unpainted].max() <= 1
        labels = [(out / "labels" / f"{stored.frame.id}{label}.txt").read_text() for label in ("", "--red")]
        assert labels[0] == labels[1] != ""
    assert [(move.done, move.total) for move in moves] == [(i, 4) for i in range(1, 5)]


def test_a_pattern_is_what_an_optimization_shows(mini: Dataset, tmp_path: Path) -> None:
    """To the bit: the same renderer."""
    pixels = np.random.default_rng(0).integers(0, 256, (64, 64, 3), np.uint8)
    path = tmp_path / "noise.json"
    save_camouflage(path, Camouflage("noise", "box", mini.plan.atlas_id, 64, "own"), png_bytes(pixels))
    export_camouflaged(mini.folder, [str(path)], "coco", tmp_path / "out")
    render = Renderer(mini, 64)
    texture = render.new_texture()
    texture[:] = 0
    texture += np.moveaxis(load_paint(path).texture, -1, 0).astype(np.float32) / 255
    frame = mini.frames()[0].id
    shown = to_bytes(render(texture, [frame])[0][0].permute(1, 2, 0).numpy())
    assert np.array_equal(read_image(tmp_path / "out" / "images" / f"{frame}--noise.png"), shown)


def test_coco_says_which_camouflage_and_the_same_masks(mini: Dataset, red: Path, tmp_path: Path) -> None:
    export_camouflaged(mini.folder, [str(red)], "coco", tmp_path / "coco")
    said = json.loads((tmp_path / "coco" / "annotations.json").read_text())
    assert [image["camouflage"] for image in said["images"]] == ["", "red"] * 4
    assert {image["split"] for image in said["images"]} == {""}  # of one place
    assert {image["file_name"] for image in said["images"]} == {
        f"images/{path.name}" for path in (tmp_path / "coco" / "images").iterdir()
    }
    own = {image["id"]: [a for a in said["annotations"] if a["image_id"] == image["id"]] for image in said["images"]}
    for plain, worn in zip(said["images"][::2], said["images"][1::2], strict=True):
        for a, b in zip(own[plain["id"]], own[worn["id"]], strict=True):
            assert (a["bbox"], a["segmentation"], a["category_id"]) == (b["bbox"], b["segmentation"], b["category_id"])


def in_four_places(mini: Dataset, composed: tuple[str, ...] = ()) -> None:
    """The frames of the one place stand in three others, too, and say what they were composed from."""
    write_json(mini.folder / "dataset.json", replace(mini.plan, locations=4).to_json())
    for frame in mini.frames():
        for place in (0, 1, 2, 3):
            copy = mini.folder / "frames" / frame.id.replace("L00", f"L{place:02d}")
            if place:
                shutil.copytree(mini.frame_folder(frame.id), copy)
            record = replace(frame, id=copy.name, location=place, composed=composed)
            write_json(copy / "frame.json", record.to_json())


def test_composed_frames_are_learnt_from_and_never_in_val(mini: Dataset, tmp_path: Path) -> None:
    """Those of the held-out place show what is judged on, and are in neither list."""
    in_four_places(mini, composed=("L00-V000-noon",))
    out = tmp_path / "out"
    export_dataset(mini.folder, "yolo", out)
    train = (out / "train.txt").read_text().split()
    assert {line.split("-")[0] for line in train} == {f"./images/L{place:02d}" for place in (0, 1, 2)}
    assert (out / "val.txt").read_text() == ""
    assert "name here the val.txt of an export of the rendered data set" in (out / "data.yaml").read_text()
    export_dataset(mini.folder, "coco", out)
    said = json.loads((out / "annotations.json").read_text())["images"]
    assert {(image["location"], image["split"], image["composed"]) for image in said} == {
        (0, "train", True), (1, "train", True), (2, "train", True), (3, "unused", True),
    }  # fmt: skip


def test_a_frame_and_its_camouflages_are_in_one_split(mini: Dataset, red: Path, tmp_path: Path) -> None:
    """Of four places the last is held out, whatever is worn there."""
    in_four_places(mini)
    out = tmp_path / "out"
    export_camouflaged(mini.folder, [str(red)], "yolo", out)
    train, val = ((out / f"{split}.txt").read_text().split() for split in ("train", "val"))
    assert {line.split("-")[0] for line in train} == {f"./images/L{place:02d}" for place in (0, 1, 2)}
    assert {line.split("-")[0] for line in val} == {"./images/L03"}
    assert (len(train), len(val)) == (24, 8)
    assert all((out / line).is_file() for line in train + val)
    export_camouflaged(mini.folder, [str(red)], "coco", out)
    said = json.loads((out / "annotations.json").read_text())["images"]
    assert {(image["location"], image["split"]) for image in said} == {
        (0, "train"), (1, "train"), (2, "train"), (3, "val"),
    }  # fmt: skip


def test_lists_name_what_this_export_wrote(mini: Dataset, red: Path, tmp_path: Path) -> None:
    """A trainer that goes by them is not given what an earlier export left."""
    out = tmp_path / "out"
    export_camouflaged(mini.folder, [str(red)], "yolo", out)
    export_dataset(mini.folder, "yolo", out)
    assert sorted((out / "train.txt").read_text().split()) == sorted(f"./images/{f.id}.png" for f in mini.frames())


def test_mistakes_are_one_line_before_anything_is_written(mini: Dataset, red: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"

    def refused(match: str, *camouflages: object) -> None:
        with pytest.raises(RaucaError, match=match) as caught:
            export_camouflaged(mini.folder, list(map(str, camouflages)), "yolo", out)
        assert "\n" not in str(caught.value)
        assert not out.exists()

    foreign = camouflage(mini, tmp_path / "foreign.json", "foreign", atlas="ffff")
    refused(
        r"foreign\.json: made for UV atlas ffff of box, there are box \(.*\); `rauca optimize .*mini` makes one",
        foreign,
    )
    refused(r"nothing\.json: not found", tmp_path / "nothing.json")
    refused("called 'red' as .* is; name one: LABEL=", red, camouflage(mini, tmp_path / "two.json", "red"))
    refused("cannot be called 'plain'", f"plain={red}")
    write_json(mini.folder / "dataset.json", replace(mini.plan, light=False).to_json())
    refused("mini: made without light maps, .* by `rauca dataset make` without --no-light", red)


def test_a_disk_that_is_too_small_is_met_first(
    mini: Dataset, red: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    monkeypatch.setattr(export, "require_space", lambda folder, needed: asked.append(needed))
    for _ in range(2):
        export_camouflaged(mini.folder, [str(red)], "coco", tmp_path / "out")
    assert asked == [8 * 3 * mini.plan.size**2, 0]


def test_the_command_takes_camouflages(mini: Dataset, red: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    said = rauca(
        "export", mini.folder, "--format", "yolo", "--camouflage", red, "--camouflage", f"b={red}", "--out", out
    )
    assert said.exit_code == 0, said.output
    assert len(names_in(out / "images")) == 12
    assert "18 targets" in said.stderr
