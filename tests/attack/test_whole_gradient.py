"""Eq. 8 differentiated from the detector's loss back to the UV map, against finite differences."""

from __future__ import annotations

from typing import Any

import torch

from rauca_core.attack import Augmentation, SmoothLoss, attack_loss, detection_score, make_settings
from rauca_core.attack.frames import FrameStore, boxes_of, render_batch
from rauca_core.contract import Dataset
from rauca_core.contract.seeding import named_rng
from rauca_core.render import Canvas, undisplay


def test_gradient_of_the_total_loss(dataset: Dataset, small_detector: Any) -> None:
    store = FrameStore(dataset, make_settings(map_size=32, samples=2))
    batch = [store.ready(0), store.ready(4)]
    roa = Augmentation.draw(named_rng("gradient"), 2)
    smooth = SmoothLoss(store.pyramid.texels, 32)

    def total(texels: torch.Tensor) -> torch.Tensor:
        images, boxes = roa(render_batch(batch, Canvas(store.pyramid, undisplay(texels))), boxes_of(batch).double())
        losses = attack_loss(detection_score(small_detector.dense(images), boxes, 1))
        return losses.mean() + 0.01 * smooth(texels)

    generator = torch.Generator().manual_seed(0)
    start = torch.rand(len(store.pyramid.texels), 3, dtype=torch.float64, generator=generator) * 0.8 + 0.1
    assert torch.autograd.gradcheck(total, start.requires_grad_(), fast_mode=True, atol=1e-7, rtol=1e-4)
