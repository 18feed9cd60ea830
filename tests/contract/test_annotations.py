"""Labels, other vehicles, checksums and recoloring: what the contract says of a frame beyond its camera."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rauca_core.contract import FramePasses, RaucaError, load_frame, save_frame
from rauca_core.contract.color import TEST, TRAIN, check_color, find_colors, hex_name, recolor, srgb_to_linear
from rauca_core.contract.files import file_digest, read_sums
from rauca_core.contract.semantics import (
    CLASS_IDS,
    CLASSES,
    PALETTE,
    VEHICLE_CLASSES,
    Instance,
    find_instances,
    mask_box,
)
from rauca_core.runtime.images import read_image

from .samples import SIZE, a_frame, some_passes

TRUCK = Instance(7, "truck", (0.0, 0.0, 4.0, 6.0), 24)


def labeled(**changes: object) -> FramePasses:
    """Every class, and a truck."""
    passes = some_passes(semantic=np.random.default_rng(0).integers(0, len(CLASSES), (SIZE, SIZE), np.uint8), **changes)
    return replace(passes, instances=np.pad(np.full((6, 4), 7, np.uint8), ((0, SIZE - 6), (0, SIZE - 4))))


def test_classes_have_a_color_each():
    assert PALETTE.shape == (len(CLASSES), 3)
    assert len({tuple(c) for c in PALETTE.tolist()}) == len(CLASSES)
    assert set(VEHICLE_CLASSES) <= set(CLASSES)
    assert (CLASS_IDS["paint"], CLASS_IDS["other"]) == (11, 16)  # ids are in files on people's disks


def test_labels_instances_and_check_survive_the_disk(tmp_path):
    passes = labeled()
    passes.check_linear = passes.image_linear
    frame = a_frame(id="f", check_srgb=(1, 2, 3), instances=(TRUCK,))
    save_frame(tmp_path / "f", frame, passes)
    assert load_frame(tmp_path / "f").to_json() == frame.to_json()
    assert load_frame(tmp_path / "f").instances == (TRUCK,)
    semantic = tmp_path / "f" / "semantic.png"
    for read in (read_image(semantic), cv2.imread(str(semantic), cv2.IMREAD_UNCHANGED), cv2.imread(str(semantic), 0)):
        assert np.array_equal(read, passes.semantic)
    assert np.array_equal(read_image(tmp_path / "f" / "instances.png"), passes.instances)
    assert read_image(tmp_path / "f" / "check.png").shape == (SIZE, SIZE, 3)


def test_coverage_stands_in_for_labels(tmp_path):
    passes = some_passes()
    semantic, instances = passes.labels()
    assert (semantic[passes.paint >= 0.5] == CLASS_IDS["paint"]).all()
    assert (semantic[passes.vehicle < 0.5] == CLASS_IDS["unlabeled"]).all()
    assert np.array_equal(instances == 255, passes.vehicle >= 0.5)


def test_every_file_of_a_frame_has_its_checksum(tmp_path):
    save_frame(tmp_path / "f", a_frame(id="f"), labeled())
    files = {path.name: file_digest(path) for path in (tmp_path / "f").iterdir() if path.name != "SHA256SUMS"}
    assert read_sums(tmp_path / "f") == files
    (tmp_path / "f" / "SHA256SUMS").write_text("nonsense\n")
    with pytest.raises(RaucaError, match="SHA256SUMS: damaged"):
        read_sums(tmp_path / "f")


def test_a_check_needs_its_color_and_its_render(tmp_path):
    with pytest.raises(ValueError, match="both"):
        save_frame(tmp_path / "f", a_frame(check_srgb=(1, 2, 3)), labeled())
    assert not list(tmp_path.iterdir())


def test_instances_come_from_their_pixels():
    ids = np.zeros((20, 30), np.uint8)
    ids[2:5, 3:9], ids[10:12, 20:30], ids[0, 0] = 4, 9, 255
    categories = {4: "bus", 9: "truck"}
    assert find_instances(ids, categories) == (
        Instance(4, "bus", (3.0, 2.0, 9.0, 5.0), 18),
        Instance(9, "truck", (20.0, 10.0, 30.0, 12.0), 20),
    )
    assert mask_box(ids == 255) is None


def test_recoloring_is_the_affine_model_for_every_color_at_once():
    rng = np.random.default_rng(1)
    A, B = rng.random((2, 5, 6, 3)).astype(np.float32)
    colors = np.array(TRAIN)
    images = recolor(A, B, colors)
    assert images.shape == (9, 5, 6, 3)
    assert np.array_equal(images[0], B)  # black adds nothing
    assert np.allclose(images[7], A + B)
    albedo = srgb_to_linear(np.array([255, 136, 0]) / 255)
    assert np.allclose(recolor(A, B, (255, 136, 0)), A * albedo + B)
    half = {"A": A.astype(np.float16), "B": B.astype(np.float16)}
    assert recolor(**half, colors_srgb=(9, 9, 9)).dtype == np.float32


def test_color_sets_are_apart():
    assert (len(TRAIN), len(TEST), len(set(TEST))) == (9, 32, 32)
    distance = np.abs(np.array(TEST)[:, None] - np.array(TRAIN)).max(axis=-1)
    assert distance.min() >= 48
    assert find_colors("train") == TRAIN
    assert find_colors("ff8800, #0a0b0c,ff8800") == ((255, 136, 0), (10, 11, 12))
    assert hex_name((255, 136, 0)) == "ff8800"
    with pytest.raises(RaucaError, match="colors 'red'"):
        find_colors("red")


def test_the_checked_share_is_kept_and_named_by_frame():
    ids = [f"L00-V{i:03d}-day" for i in range(2000)]
    chosen = [check_color(3, 0.1, frame_id) for frame_id in ids]
    assert sum(c is not None for c in chosen) == pytest.approx(200, abs=45)
    assert {c for c in chosen if c} <= set(TEST)
    assert chosen == [check_color(3, 0.1, frame_id) for frame_id in ids]
    assert not any(check_color(3, 0.0, frame_id) for frame_id in ids)
    assert all(check_color(3, 1.0, frame_id) for frame_id in ids)
