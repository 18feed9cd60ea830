"""The operators that stand in for torchvision's compiled ones."""

from __future__ import annotations

import importlib.util
import sys

import pytest
import torch
from torch import Tensor

from rauca_core.contract import RaucaError
from rauca_core.detect.frameworks import torchvision_ops
from rauca_core.detect.frameworks.torchvision_ops import import_torchvision

pytestmark = pytest.mark.skipif(not importlib.util.find_spec("torchvision"), reason="the extra detectors is missing")

LAYOUTS = [(7, 2, False), (7, 2, True), (7, -1, True), (4, -1, False), (3, 5, False)]


def regions(count: int, height: int, width: int, images: int) -> Tensor:
    """Random regions inside an image, thin and empty ones among them, none within 4 px of its end: (count, 5).

    There torchvision's fallback reads the border where the compiled operator, like ours, reads zero.
    """
    limit = torch.tensor([width, height], dtype=torch.float32)
    start = torch.rand(count, 2) * (limit - 4)
    end = torch.minimum(start + torch.rand(count, 2) ** 3 * limit, limit)
    end[0] = start[0]
    return torch.cat([torch.randint(images, (count, 1)).float(), start, end], 1)


@pytest.mark.parametrize(("pooled", "sampling_ratio", "aligned"), LAYOUTS)
def test_roi_align_and_its_gradient_agree_with_torchvisions_slow_fallback(
    pooled: int, sampling_ratio: int, aligned: bool
) -> None:
    import_torchvision()
    reference = sys.modules["torchvision.ops.roi_align"]._roi_align.__wrapped__
    torch.manual_seed(pooled)
    features = torch.randn(2, 3, 14, 20, requires_grad=True)
    arguments = (features, regions(30, 56, 80, 2), 0.25, pooled, pooled, sampling_ratio, aligned)
    if aligned:  # torchvision's fallback divides 0 by 0 in an empty region; the compiled operator gives 0
        arguments = (features, arguments[1][1:], *arguments[2:])
    ours, theirs = torchvision_ops.roi_align(*arguments), reference(*arguments)
    assert (ours - theirs).abs().max() < 3e-5
    weight = torch.randn_like(ours)
    gradients = [torch.autograd.grad((one * weight).sum(), features)[0] for one in (ours, theirs)]
    assert (gradients[0] - gradients[1]).abs().max() < 1e-4


def test_roi_align_gradient_is_the_derivative() -> None:
    torch.manual_seed(0)
    features = torch.randn(1, 2, 4, 5, dtype=torch.float64, requires_grad=True)
    rois = regions(4, 8, 10, 1).double()
    assert torch.autograd.gradcheck(
        lambda values: torchvision_ops.roi_align(values, rois, 0.5, 2, 2, 2, False), features
    )


def test_roi_align_reads_zero_beyond_the_map_and_takes_no_region_at_all() -> None:
    features = torch.ones(1, 3, 4, 4)
    outside = torch.tensor([[0.0, 40.0, 40.0, 48.0, 48.0]])
    assert torchvision_ops.roi_align(features, outside, 1.0, 2, 2, 2, False).abs().max() == 0
    assert torchvision_ops.roi_align(features, outside[:0], 1.0, 2, 2, -1, False).shape == (0, 3, 2, 2)


def greedy(boxes: Tensor, scores: Tensor, threshold: float) -> list[int]:
    torchvision = import_torchvision()
    left, kept = scores.argsort(descending=True, stable=True).tolist(), []
    while left:
        best = left.pop(0)
        kept.append(best)
        overlaps = torchvision.ops.box_iou(boxes[best : best + 1], boxes[left])[0] if left else []
        left = [one for one, overlap in zip(left, overlaps, strict=True) if not overlap > threshold]
    return kept


@pytest.mark.parametrize("count", [0, 1, 300])
def test_nms_is_greedy_suppression(count: int) -> None:
    torch.manual_seed(count)
    boxes = torch.rand(count, 4) * 50
    boxes[:, 2:] += boxes[:, :2]
    scores = torch.rand(count).round(decimals=2)  # with ties
    assert torchvision_ops.nms(boxes, scores, 0.4).tolist() == greedy(boxes, scores, 0.4)


def test_importing_again_changes_nothing() -> None:
    assert import_torchvision() is import_torchvision()
    torchvision = import_torchvision()
    boxes = torch.tensor([[0.0, 0.0, 4.0, 4.0], [0.0, 0.0, 4.0, 4.1]], requires_grad=True)
    assert torchvision.ops.nms(boxes, torch.tensor([0.5, 0.9]), 0.5).tolist() == [1]


def test_a_missing_torchvision_names_the_extra() -> None:
    with pytest.MonkeyPatch.context() as patch:
        for name in [name for name in sys.modules if name.partition(".")[0] == "torchvision"]:
            patch.delitem(sys.modules, name)
        patch.setattr("importlib.import_module", _not_installed)
        with pytest.raises(RaucaError, match=r"rauca\[detectors\]"):
            import_torchvision()


def _not_installed(name: str) -> None:
    raise ModuleNotFoundError(f"No module named {name!r}", name=name)
