"""Our own networks against the frameworks they are built of, and their gradients to the image."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from rauca_core.detect.batch_norm import freeze_batch_norms
from rauca_core.detect.frameworks.torchvision_ops import import_torchvision
from rauca_core.detect.frameworks.transformers_loading import import_transformers
from rauca_core.detect.nms import box_iou, corners, detections, generalized_iou
from rauca_core.detect.synth.network import Truth
from rauca_core.detect.synth.networks import build_network
from rauca_core.detect.synth.student_losses import KEEP_WEIGHT, NEAR

torch.set_num_threads(1)

SIZE = 64


@pytest.fixture(scope="module")
def two_stage(backbone: Path) -> Any:
    network = build_network("frcnn-synth", 2, backbone).eval()
    with torch.no_grad():  # drawn weights know nothing: spread their scores and boxes
        network.roi_heads.box_predictor.cls_score.weight.mul_(30)
        network.roi_heads.box_predictor.bbox_pred.weight.mul_(10)
    return network


@pytest.fixture(scope="module")
def transformer(backbone: Path) -> Any:
    return build_network("detr-synth", 2, backbone).eval()


def picture(seed: int = 0, count: int = 1, dtype: torch.dtype = torch.float32) -> Tensor:
    return torch.rand(count, 3, SIZE, SIZE, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def test_two_stage_detects_what_torchvision_would(two_stage, monkeypatch):
    heads, images = two_stage.roi_heads, picture(count=2)
    monkeypatch.setattr(heads, "nms_thresh", 1.0)  # torchvision clips boxes before it suppresses, we do after
    monkeypatch.setattr(heads, "detections_per_img", 1000)
    with torch.no_grad():
        ours = detections(two_stage.dense(images), 0.005, 1.0)
        features, frame = two_stage._features(images)
        proposals, _ = two_stage.rpn(frame, features)
        theirs, _ = heads(features, proposals, frame.image_sizes)
    for mine, reference in zip(ours, theirs, strict=True):
        assert len(reference["scores"]) >= 20
        boxes = mine.boxes.clamp(0, SIZE)
        for box, label, value in zip(reference["boxes"], reference["labels"] - 1, reference["scores"], strict=True):
            same = (mine.labels == label) & ((mine.scores - value).abs() < 1e-5)
            assert ((boxes[same] - box).abs().amax(1) < 1e-3).any()


def test_more_objects_than_queries_are_learnt(transformer):
    low = torch.rand(70, 2, generator=torch.Generator().manual_seed(0)) * 40
    side = torch.linspace(4, 20, 70)[torch.randperm(70, generator=torch.Generator().manual_seed(1))]
    crowd = Truth(torch.cat([low, low + side[:, None]], 1), torch.zeros(70, dtype=torch.int64))
    network = transformer.train()
    losses = network.losses(picture(), [crowd])
    network.eval()
    assert all(torch.isfinite(loss) for loss in losses.values())


def test_fewer_proposals_are_padded_with_nothing(two_stage, monkeypatch):
    proposals = [torch.tensor([[4.0, 4, 30, 30], [8, 8, 60, 50]]), torch.tensor([[0.0, 0, 20, 20]])]
    monkeypatch.setattr(two_stage.rpn, "forward", lambda *arguments: (proposals, {}))
    with torch.no_grad():
        found = two_stage.dense(picture(count=2))
    assert found.boxes.shape == (2, 4, 4)
    assert (found.classes[1, 2:] == 0).all()
    assert ((found.classes > 0).sum(-1) <= 1).all()


def test_a_two_stage_network_keeps_to_what_it_said_of_regions_on_no_vehicle(two_stage):
    images, student = picture(count=2), copy.deepcopy(two_stage).train()
    with torch.no_grad():
        before = two_stage.regions(images)
    vehicles = [
        Truth(torch.tensor([[4.0, 4, 30, 20]]), torch.tensor([0])),
        Truth(torch.zeros(0, 4), torch.zeros(0).long()),
    ]

    def kept(of: list[Truth]) -> Tensor:
        return student.losses(images, vehicles, before, of)["kept"]

    assert float(kept(vehicles).detach()) == pytest.approx(0, abs=1e-6)
    assert "kept" not in student.losses(images, vehicles)
    with torch.no_grad():
        student.roi_heads.box_predictor.cls_score.bias.add_(torch.tensor([0.0, 0.5, -0.5]))
        first, after = two_stage.dense(images).classes, student.eval().dense(images).classes
        student.train()
    proposals = before.boxes
    count = len(proposals[0])
    assert count == len(proposals[1]) == first.shape[1] // 2
    wanted = 0.0
    for k, truth in enumerate(vehicles):
        for n in range(count):
            if any(float(box_iou(proposals[k][n][None], box[None])) > NEAR for box in truth.boxes):
                continue
            p, q = (np.array([0, *found[k, 2 * n : 2 * n + 2].sum(0).tolist()]) for found in (first, after))
            p[0], q[0] = 1 - p[1:].sum(), 1 - q[1:].sum()
            wanted += float((p * np.log(p / q)).sum())  # of one vehicle
    loss = kept(vehicles)
    assert float(loss.detach()) == pytest.approx(KEEP_WEIGHT * wanted, rel=1e-3)
    assert 0 < float(loss.detach()) < float(kept([vehicles[1]] * 2).detach())  # without the vehicle more regions count
    loss.backward()
    assert float(student.roi_heads.box_predictor.cls_score.bias.grad.abs().sum()) > 0
    assert not any(p.grad is not None for p in two_stage.parameters())
    everything = Truth(
        torch.cat([boxes + torch.tensor([-1e-3, -1e-3, 1e-3, 1e-3]) for boxes in proposals]),
        torch.zeros(2 * count).long(),
    )
    assert float(kept([everything] * 2).detach()) == 0


def test_transformer_decodes_as_transformers_does(transformer):
    images = picture(count=2)
    with torch.no_grad():
        ours, raw = transformer.dense(images), transformer.detr(images)
    processor = import_transformers().models.rt_detr.image_processing_rt_detr.RTDetrImageProcessor
    outputs = type("Outputs", (), {})()
    outputs.logits, outputs.pred_boxes = raw.intermediate_logits[:, -1], raw.intermediate_reference_points[:, -1]
    theirs = processor().post_process_object_detection(outputs, threshold=0.0, target_sizes=[(SIZE, SIZE)] * 2)
    for k, reference in enumerate(theirs):
        for value, label, box in zip(reference["scores"], reference["labels"], reference["boxes"], strict=True):
            close = (ours.classes[k, :, label] - value).abs() < 1e-6
            assert ((ours.boxes[k, close] - box).abs().amax(1) < 1e-3).any()


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_flat_images_keep_everything_finite(two_stage, transformer, value):
    for network in (two_stage, transformer):
        images = torch.full((1, 3, SIZE, SIZE), value, requires_grad=True)
        found = network.dense(images)
        (found.boxes.sum() + found.classes.sum()).backward()
        assert all(torch.isfinite(t).all() for t in (found.boxes, found.classes, images.grad))


def test_generalized_overlap_is_torchvisions():
    ops = import_torchvision().ops
    a, b = (corners(torch.rand(9, 4, generator=torch.Generator().manual_seed(k)) + 0.1) for k in (0, 1))
    torch.testing.assert_close(generalized_iou(a[:, None], b[None]), ops.generalized_box_iou(a, b))


@pytest.mark.parametrize("count", [1, 2])
def test_frozen_batch_norm_takes_gradients_of_any_layout(count):
    generator = torch.Generator().manual_seed(0)
    norm = torch.nn.BatchNorm2d(16).double()
    with torch.no_grad():
        for parameter in (norm.weight, norm.bias, norm.running_mean, norm.running_var):
            parameter.copy_(torch.rand(16, generator=generator) + 0.5)
    x = torch.randn(count, 16, 5, 5, dtype=torch.float64, generator=generator).requires_grad_()
    weight = torch.randn(count, 25, 16, dtype=torch.float64, generator=generator)
    frozen = freeze_batch_norms(torch.nn.Sequential(norm))
    torch.testing.assert_close(frozen(x), norm.eval()(x))
    assert torch.autograd.gradcheck(lambda x: (frozen(x).flatten(2).transpose(1, 2) * weight).sum(), x)
