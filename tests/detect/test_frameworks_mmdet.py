"""MMDetection's configurations and folders: what is read of them, and what is refused."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest
import torch

from rauca_core.contract import RaucaError
from rauca_core.detect import load_detector
from rauca_core.detect.families import MMDET_INSTALL
from rauca_core.detect.frameworks.mmdet_config import read_config
from rauca_core.detect.frameworks.mmdet_detector import MmdetDetector

PREPROCESSOR = {
    "type": "DetDataPreprocessor", "mean": [103.5, 116.3, 123.7], "std": [57.0, 57.1, 58.4], "bgr_to_rgb": False,
    "pad_size_divisor": 32,
}  # fmt: skip
STEPS: list[dict[str, Any]] = [
    {"type": "LoadImageFromFile"},
    {"type": "Resize", "scale": [160, 96], "keep_ratio": True},
    {"type": "PackDetInputs"},
]
RETINANET = {
    "type": "RetinaNet",
    "backbone": {"type": "ResNet", "depth": 18, "init_cfg": {"type": "Pretrained", "checkpoint": "torchvision://x"}},
    "neck": {"type": "FPN", "in_channels": [64, 128, 256, 512], "out_channels": 32, "start_level": 1,
             "add_extra_convs": "on_input", "num_outs": 5},
    "bbox_head": {
        "type": "RetinaHead", "num_classes": 2, "in_channels": 32, "feat_channels": 32, "stacked_convs": 1,
        "anchor_generator": {"type": "AnchorGenerator", "octave_base_scale": 4, "scales_per_octave": 3,
                             "ratios": [0.5, 1.0, 2.0], "strides": [8, 16, 32, 64, 128]},
        "bbox_coder": {"type": "DeltaXYWHBBoxCoder"}, "loss_cls": {"type": "FocalLoss", "use_sigmoid": True},
    },
    "test_cfg": {"nms_pre": 1000, "score_thr": 0.05, "nms": {"type": "nms", "iou_threshold": 0.5}, "max_per_img": 100},
}  # fmt: skip


def written(path: Path, steps: list[dict[str, Any]] | None = None, **model: Any) -> Path:
    described = RETINANET | {"data_preprocessor": PREPROCESSOR} | model
    pipeline = STEPS if steps is None else steps
    path.write_text(json.dumps({"model": described, "test_dataloader": {"dataset": {"pipeline": pipeline}}}))
    return path


def test_images_are_scaled_normalized_and_padded_as_described(tmp_path: Path) -> None:
    described = read_config(written(tmp_path / "config.json"))
    preparation = described.preparation
    assert "init_cfg" not in described.model["backbone"]  # it would be downloaded
    images = torch.full((1, 3, 30, 70), 0.5)
    images[:, 0] = 1.0
    fitted = preparation.fit("x", images).batch
    assert preparation.fit("x", images).size == (69, 160)
    assert fitted.shape == (1, 3, 96, 160)
    assert fitted[0, 2, 0, 0].item() == pytest.approx((255 - 123.7) / 58.4)  # red is the last of blue, green, red
    assert fitted[0, 0, 68, 159].item() == pytest.approx((127.5 - 103.5) / 57.0)
    assert (fitted[:, :, 69:] == 0).all()
    last = images.contiguous(memory_format=torch.channels_last)  # as the attack's pictures come
    assert preparation.fit("x", last).batch.is_contiguous()
    assert torch.equal(preparation.fit("x", last).batch, fitted)
    with pytest.raises(RaucaError, match="too narrow"):
        preparation.fit("x", torch.rand(1, 3, 1, 2000))


def test_images_are_padded_before_they_are_normalized_where_the_pipeline_says_so(tmp_path: Path) -> None:
    steps = [*STEPS, {"type": "Pad", "pad_to_square": True, "pad_val": {"img": [114.0, 114.0, 7.0]}}]
    preparation = read_config(written(tmp_path / "config.json", steps)).preparation
    prepared = preparation.fit("x", torch.ones(1, 3, 30, 70))
    assert (prepared.size, prepared.framed, prepared.batch.shape[2:]) == ((69, 160), (160, 160), (160, 160))
    filled = prepared.batch[0, :, 100, 0]
    assert filled.tolist() == pytest.approx([(114 - 103.5) / 57.0, (114 - 116.3) / 57.1, (7 - 123.7) / 58.4], abs=1e-5)
    fixed = [*STEPS, {"type": "Pad", "size": [200, 100]}]
    prepared = read_config(written(tmp_path / "config.json", fixed)).preparation.fit("x", torch.ones(1, 3, 30, 70))
    assert (prepared.framed, prepared.batch.shape[2:]) == ((100, 200), (128, 224))
    with pytest.raises(RaucaError, match="must resize once and then pad at most once"):
        read_config(written(tmp_path / "config.json", [*fixed, fixed[-1]]))


FLAT = """
classes = ("vehicle.car", "bus")
optim_wrapper = dict(paramwise=lambda name: name)
model = dict(type="RetinaNet", data_preprocessor=PREPROCESSOR, bbox_head=dict(num_classes=2, offset=-0.5, last=None))
test_dataloader = dict(dataset=dict(metainfo=dict(classes=("vehicle.car", "bus")), pipeline=STEPS))
"""


def test_a_python_configuration_of_plain_values_is_read_and_not_run(tmp_path: Path) -> None:
    flat = tmp_path / "config.py"
    flat.write_text(FLAT.replace("PREPROCESSOR", repr(PREPROCESSOR)).replace("STEPS", repr(STEPS)))
    described = read_config(flat)
    assert described.model["bbox_head"] == {"num_classes": 2, "offset": -0.5, "last": None}
    assert described.class_names == ("vehicle.car", "bus")
    assert described.preparation == read_config(written(tmp_path / "config.json")).preparation


def test_configurations_that_could_run_code_are_refused(tmp_path: Path) -> None:
    script = tmp_path / "config.py"
    mark = f"open({str(tmp_path / 'ran')!r}, 'w')"
    for text in (
        mark,
        f"model = {mark}",
        f"model = dict(type={mark})",
        "_base_ = ['other.py']",
        "import os",
        "model = (",
    ):
        script.write_text(text + "\n")
        with pytest.raises(RaucaError, match=r"config\.py: would have to be run .*Config\.fromfile"):
            read_config(script)
    assert not (tmp_path / "ran").exists()
    for kind in ("os.system", "mmdet.apis.os.system", "builtins.exec", 3, ""):
        path = written(tmp_path / "config.json", neck={"blocks": [{"type": kind, "command": "true"}]})
        with pytest.raises(RaucaError, match="is not the name of a registered module"):
            read_config(path)


def test_what_is_not_understood_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "config.json"
    path.write_text(json.dumps({"model": {"type": "FasterRCNN"}}))
    with pytest.raises(RaucaError, match="describes no model of MMDetection 3"):
        read_config(path)
    with pytest.raises(RaucaError, match="step LoadProposals of its test pipeline is not supported"):
        read_config(written(path, [*STEPS, {"type": "LoadProposals"}]))
    with pytest.raises(RaucaError, match="is not understood"):
        read_config(written(path, [STEPS[0] | {"type": "Resize"}]))
    with pytest.raises(RaucaError, match="data_preprocessor BatchPreprocessor is not supported"):
        read_config(written(path, data_preprocessor=PREPROCESSOR | {"type": "BatchPreprocessor"}))


def test_a_folder_must_hold_one_configuration_and_one_checkpoint(tmp_path: Path) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "epoch_1.pth").touch()
    with pytest.raises(RaucaError, match=r"mine: must hold exactly one configuration \(\.py\), found none"):
        load_detector(folder)
    written(folder / "config.json")
    (folder / "epoch_2.pth").touch()
    with pytest.raises(RaucaError, match=r"exactly one checkpoint .*found epoch_1\.pth, epoch_2\.pth"):
        load_detector(folder)  # its config.json is MMDetection's, not transformers'


def test_without_mmdetection_the_error_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mmdet", None)  # as if it were not there
    with pytest.raises(RaucaError) as told:
        MmdetDetector("retinanet", written(tmp_path / "config.json"), tmp_path / "weights.pth")
    assert MMDET_INSTALL in str(told.value)


def test_the_documentation_installs_mmdetection_as_the_error_says() -> None:
    page = (Path(__file__).parents[2] / "docs" / "detectors.md").read_text()
    assert all(f"    {command}\n" in page for command in MMDET_INSTALL.split(" && "))
