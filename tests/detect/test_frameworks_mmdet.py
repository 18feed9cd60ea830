"""MMDetection's adapter: what it refuses, everywhere; that it predicts, where MMDetection is installed."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import nn

from rauca_core.contract import RaucaError
from rauca_core.detect.frameworks.mmdet_detector import MmdetDetector, read_config

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
    described, preparation = read_config(written(tmp_path / "config.json"))
    assert "init_cfg" not in described["backbone"]  # it would be downloaded
    images = torch.full((1, 3, 30, 70), 0.5)
    images[:, 0] = 1.0
    fitted, size = preparation.fit("x", images)
    assert size == (69, 160)
    assert fitted.shape == (1, 3, 96, 160)
    assert fitted[0, 2, 0, 0].item() == pytest.approx((255 - 123.7) / 58.4)  # red is the last of blue, green, red
    assert fitted[0, 0, 68, 159].item() == pytest.approx((127.5 - 103.5) / 57.0)
    assert (fitted[:, :, 69:] == 0).all()
    last, _ = preparation.fit(
        "x", images.contiguous(memory_format=torch.channels_last)
    )  # as the attack's pictures come
    assert last.is_contiguous()
    assert torch.equal(last, fitted)
    with pytest.raises(RaucaError, match="too narrow"):
        preparation.fit("x", torch.rand(1, 3, 1, 2000))


def test_configurations_that_could_run_code_are_refused(tmp_path: Path) -> None:
    script = tmp_path / "config.py"
    script.write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n")
    with pytest.raises(RaucaError, match=r"config\.py: a configuration in Python would be run; dump it"):
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
    with pytest.raises(RaucaError, match="step Pad of its test pipeline is not supported"):
        read_config(written(path, [*STEPS, {"type": "Pad", "size": [640, 640]}]))
    with pytest.raises(RaucaError, match="is not understood"):
        read_config(written(path, STEPS[:1]))
    with pytest.raises(RaucaError, match="data_preprocessor BatchPreprocessor is not supported"):
        read_config(written(path, data_preprocessor=PREPROCESSOR | {"type": "BatchPreprocessor"}))


@pytest.mark.skipif(importlib.util.find_spec("mmdet") is not None, reason="MMDetection is installed")
def test_without_mmdetection_the_error_says_how_to_install_it(tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match=r"MMDetection 3 cannot be imported .*mmdet==3"):
        MmdetDetector("retinanet", written(tmp_path / "config.json"), tmp_path / "weights.pth")


@pytest.mark.skipif(importlib.util.find_spec("mmdet") is None, reason="MMDetection is not installed")
def test_a_detector_of_mmdetection_detects_and_is_differentiable(tmp_path: Path) -> None:
    from rauca_core.detect.frameworks.mmdet_detector import import_registry

    path = written(tmp_path / "config.json")
    registry = import_registry()
    from mmengine.config import ConfigDict

    torch.manual_seed(0)
    model = registry.build(ConfigDict(read_config(path)[0]))
    nn.init.normal_(model.bbox_head.retina_cls.weight, std=0.05)
    nn.init.constant_(model.bbox_head.retina_cls.bias, -2.0)
    torch.save({"meta": {"epoch": 12}, "state_dict": model.state_dict()}, tmp_path / "weights.pth")
    detector = MmdetDetector("retinanet", path, tmp_path / "weights.pth", ("car", "bus"))
    images = torch.rand(2, 3, 40, 70, requires_grad=True)
    dense = detector.dense(images)
    assert dense.boxes.shape == (2, dense.objectness.shape[1], 4)
    assert dense.classes.shape[2] == 2
    (dense.objectness[..., None] * dense.classes).amax((1, 2)).sum().backward()
    assert images.grad is not None
    assert (images.grad.abs().sum((1, 2, 3)) > 0).all()
    assert all(len(found.scores) > 0 for found in detector.detect(images.detach(), 0.05, 0.5))
