"""Images that no detector can judge are one error each; good ones pass untouched."""

from __future__ import annotations

import re
from typing import Any

import pytest
import torch
from torch import Tensor

from rauca_core.contract import RaucaError
from rauca_core.detect import DarknetDetector, check_images, load_detector
from rauca_core.detect import interface as checks


def with_value(value: float) -> Tensor:
    images = torch.rand(3, 3, 20, 24)
    images[1, 2, 5, 7] = value
    return images


BAD: dict[str, Any] = {
    "must be a torch tensor, not list": [[0.0]],
    "shape (B, 3, H, W), not (3, 20, 24)": torch.rand(3, 20, 24),
    "shape (B, 3, H, W), not (1, 20, 24, 3)": torch.rand(1, 20, 24, 3),
    "shape (B, 3, H, W), not (0, 3, 20, 24)": torch.rand(0, 3, 20, 24),
    "floating point, not torch.uint8; divide by 255": torch.zeros(1, 3, 20, 24, dtype=torch.uint8),
    "found values from 0 to 255": torch.linspace(0, 255, 3 * 64).view(1, 3, 8, 8),
    "found values from -2.1 to 2.6": torch.linspace(-2.1, 2.6, 3 * 64).view(1, 3, 8, 8),
    "image 1 of the batch holds 1 NaN or infinite": with_value(torch.nan),
    "image 1 of the batch holds 1 NaN or infinite values": with_value(torch.inf),
    "image 1 of the batch holds 1 NaN or": with_value(-torch.inf),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_images(message: str, detector: DarknetDetector) -> None:
    for call in (detector.dense, detector.detect):
        with pytest.raises(RaucaError, match=f"every: .*{re.escape(message)}"):
            call(BAD[message])


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
def test_the_ends_of_the_range_pass(dtype: torch.dtype) -> None:
    check_images("mine", torch.tensor([0.0, 1.0, 0.5], dtype=dtype).view(1, 3, 1, 1))


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float64])
def test_other_floating_types_become_the_networks(dtype: torch.dtype, detector: DarknetDetector) -> None:
    images = torch.rand(1, 3, 40, 52).to(dtype).requires_grad_()
    for one in (detector, load_detector("frcnn-synth")):
        found, same = one.dense(images), one.dense(images.detach().float())
        assert torch.equal(found.boxes, same.boxes)
        assert torch.equal(found.classes, same.classes)
        assert torch.equal(one.detect(images)[0].boxes, one.detect(images.float())[0].boxes)
    detector.dense(images).objectness.sum().backward()
    assert images.grad is not None
    assert images.grad.abs().sum() > 0


def test_values_on_another_device_are_looked_at_only_when_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[str] = []
    monkeypatch.setattr(checks, "_check_values", lambda name, _: looked.append(name))
    images = torch.empty(1, 3, 8, 8, device="meta")
    check_images("attack", images)
    check_images("evaluation", images, waits=True)
    assert looked == ["evaluation"]
