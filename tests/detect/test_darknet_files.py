"""Every wrong file is refused in one line that says where and what."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from rauca_core.contract import RaucaError
from rauca_core.detect import SOURCES, DarknetDetector, load_detector
from rauca_core.detect.cfg import read_cfg
from rauca_core.detect.darknet import read_weights
from rauca_core.detect.darknet_network import DarknetNetwork


@pytest.mark.parametrize(
    ("before", "after", "complaint"),
    [
        ("activation=mish", "activation=gelu", r"every.cfg:13: \[convolutional\] activation 'gelu' is not supported"),
        ("filters=16", "filters=many", r"every.cfg:\d+: \[convolutional\] filters must be a whole number"),
        ("filters=16", "filters=16\nfilters=16", r"option filters is given twice"),
        ("filters=16", "filtres=16", r"\[convolutional\] option filtres is not supported"),
        ("filters=16\n", "", r"every.cfg:\d+: \[convolutional\] option filters is missing"),
        ("filters=21", "filters=20", r"\[yolo\] needs 21 channels, the layer before it makes 20"),
        ("num=4\nscale", "num=5\nscale", r"8 anchor values, expected two for each"),
        ("mask=1,2,3", "mask=1,2,4", r"\[yolo\] mask must be whole numbers .* between 0 and 3"),
        ("layers=-1,3", "layers=-1,90", r"\[route\] layers points outside the \d+ layers before it"),
        ("layers=-1,3", "layers=-1,0", r"\[route\] layers joins layers of different sizes"),
        ("from=-2", "from=-1,-2", r"\[shortcut\] from must name one layer of the same shape"),
        ("groups=2", "groups=3", r"\[route\] 3 groups do not divide the channels"),
        ("[upsample]", "[deconvolution]", r"section \[deconvolution\] is not supported"),
        ("size=5", "size 5", r"expected `option=value`, found 'size 5'"),
        ("[net]", "", r"every.cfg:3: option width stands before any section"),
        ("scale_x_y=1.05", "scale_x_y=1.05\nnew_coords=1", r"\[yolo\] option new_coords is not supported"),
        ("channels=3", "channels=1", r"\[net\] channels must be a whole number between 3 and 3"),
    ],
)
def test_a_wrong_cfg_is_refused(cfg: Path, before: str, after: str, complaint: str) -> None:
    text = cfg.read_text()
    assert before in text
    cfg.write_text(text.replace(before, after, 1))
    with pytest.raises(RaucaError, match=complaint) as refusal:
        DarknetNetwork(cfg)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("content", [b"", b"# nothing\n", b"[net]\nwidth=32\n", b"\xff\xfe\x00", b"\x89PNG\r\n"])
def test_something_else_than_a_cfg_is_refused(cfg: Path, content: bytes) -> None:
    cfg.write_bytes(content)
    with pytest.raises(RaucaError, match=r"every\.cfg"):
        read_cfg(cfg)


def test_training_options_are_skipped(cfg: Path) -> None:
    cfg.write_text(cfg.read_text().replace("channels=3", "channels=3\nlearning_rate=0.1\nburn_in=1000"))
    assert len(DarknetNetwork(cfg).layers) == len(read_cfg(cfg)[1])


@pytest.mark.parametrize("change", [-4, -1, 4, 400_000])
def test_weights_of_another_length_are_refused(cfg: Path, weights: Path, change: int) -> None:
    data = weights.read_bytes()
    weights.write_bytes(data[:change] if change < 0 else data + bytes(change))
    with pytest.raises(RaucaError, match=rf"expected {len(data)} bytes for this network, found {len(data) + change}"):
        read_weights(weights, DarknetNetwork(cfg))


def test_empty_and_missing_weights_are_refused(cfg: Path, weights: Path) -> None:
    weights.write_bytes(b"")
    with pytest.raises(RaucaError, match=r"expected \d+ bytes for this network, found 0"):
        read_weights(weights, DarknetNetwork(cfg))
    weights.unlink()
    with pytest.raises(RaucaError, match=r"every\.weights: not found"):
        read_weights(weights, DarknetNetwork(cfg))


def test_weights_that_are_not_finite_are_refused(cfg: Path, weights: Path) -> None:
    values = np.fromfile(weights, "<f4")
    values[-3] = np.nan
    values.tofile(weights)
    with pytest.raises(RaucaError, match="not finite"):
        read_weights(weights, DarknetNetwork(cfg))


def test_an_old_header_has_four_bytes_fewer(cfg: Path, weights: Path) -> None:
    data = weights.read_bytes()
    old = weights.with_name("old.weights")
    old.write_bytes(np.array([0, 1, 0, 7], "<i4").tobytes() + data[20:])
    networks = DarknetNetwork(cfg), DarknetNetwork(cfg)
    for network, path in zip(networks, (weights, old), strict=True):
        read_weights(path, network)
    for first, second in zip(networks[0].parameters(), networks[1].parameters(), strict=True):
        assert torch.equal(first, second)


def test_sizes_and_class_lists_are_checked(cfg: Path, weights: Path) -> None:
    with pytest.raises(RaucaError, match="input size 100 must be a multiple of 8 pixels"):
        DarknetDetector("every", cfg, weights, ("car", "boat"), 100)
    with pytest.raises(RaucaError, match="predicts 2 classes, 3 names"):
        DarknetDetector("every", cfg, weights, ("car", "boat", "kite"), 64)


def test_the_fingerprint_follows_weights_and_size(
    cfg: Path, weights: Path, random_weights: Callable[..., Path]
) -> None:
    def fingerprint(size: int) -> str:
        return DarknetDetector("every", cfg, weights, ("car", "boat"), size).fingerprint

    first = fingerprint(64)
    assert fingerprint(64) == first
    assert fingerprint(72) != first
    random_weights(weights, cfg, seed=1)
    assert fingerprint(64) != first


def test_a_mended_names_file_makes_another_fingerprint(cfg: Path, weights: Path) -> None:
    """What is kept under a fingerprint names classes, so detections under swapped names must not answer again."""

    def fingerprint(names: str) -> str:
        cfg.with_suffix(".names").write_text(names)
        return load_detector(str(weights), 64).fingerprint

    assert fingerprint("car\nboat\n") != fingerprint("boat\ncar\n")
    assert fingerprint("aeroplane\ncar\n") == fingerprint("airplane\nCar\n")  # kept in COCO's words


def test_a_detector_by_path_needs_its_cfg_and_names_beside_it(cfg: Path, weights: Path) -> None:
    with pytest.raises(RaucaError, match=r"every\.names: not found; it must lie beside"):
        load_detector(str(weights))
    cfg.with_suffix(".names").write_text("car\nboat\n")
    detector = load_detector(str(weights), 64)
    assert (detector.name, detector.class_names) == ("every", ("car", "boat"))
    cfg.unlink()
    with pytest.raises(RaucaError, match=r"every\.cfg: not found"):
        load_detector(str(weights))


def test_a_named_network_takes_the_users_weights(tmp_path: Path, random_weights: Callable[..., Path]) -> None:
    weights = random_weights(tmp_path / "mine.weights", SOURCES["yolov4-tiny"].cfg)
    detector = load_detector(f"yolov4-tiny={weights}", 64)
    assert detector.name == "yolov4-tiny"
    assert len(detector.detect(torch.rand(1, 3, 48, 64))) == 1
    weights.write_bytes(weights.read_bytes()[:-100])
    with pytest.raises(RaucaError, match="expected 24251276 bytes for this network, found 24251176"):
        load_detector(f"yolov4-tiny={weights}", 64)
