"""The attack inside a training step: it moves paint alone, to where the loss grows, and a training with it resumes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from benchmarks.stability.drawn import make_dataset
from rauca_core.contract import Vehicle
from rauca_core.contract.seeding import named_rng
from rauca_core.environment.frames import LightFrames
from rauca_core.training.inner_attack import attacked
from rauca_core.training.samples import Samples

SIZE = 64


def test_an_image_is_the_same_in_another_paint_but_for_the_paint(tmp_path: Path, box_vehicle: Vehicle) -> None:
    samples = Samples(LightFrames([make_dataset(tmp_path, box_vehicle, SIZE, (40.0, 130.0)).folder]), ("car",), SIZE)
    for number, shown in enumerate(([0], [1], [0, 1, 2, 3])):
        paints = (None, torch.zeros(3, 1, 1), torch.ones(3, 1, 1))
        drawn, black, white = (samples.draw(shown, named_rng("sight", number), paint) for paint in paints)
        assert torch.equal(black.truth.boxes, drawn.truth.boxes)
        painted = (white.image - black.image).amax(0) > 0.2
        assert 0.01 < float(painted.float().mean()) < 0.9
        assert (drawn.image - black.image).amin() > -0.15  # JPEG and the frame's noise alone
        assert (white.image - drawn.image).amin() > -0.15


@pytest.mark.parametrize("seed", [0, 1, 4, 11, 21])  # they draw cells of 64, 16, 32, 4 and 8 pixels
def test_a_step_moves_paint_alone_and_the_loss_grows(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    images = torch.rand(2, 3, 147, 200, generator=generator) * 0.5 + 0.25
    black, white = images.clone(), images.clone()
    black[0, :, 30:130, 20:180], white[0, :, 30:130, 20:180] = 0.1, 0.9
    weights = torch.randn(images.shape, generator=generator)

    def loss(seen: torch.Tensor) -> torch.Tensor:
        return (weights * seen).sum()

    moved = attacked(images, black, white, loss, 0.3, np.random.default_rng(seed))
    assert torch.equal(moved[1], images[1])
    change = (moved - images)[0].abs().amax(0)
    inside = torch.zeros(147, 200, dtype=torch.bool)
    inside[30:130, 20:180] = True
    assert float(change[~inside].max()) == 0
    assert 0.2 < float((change[inside] > 0).float().mean()) < 0.9  # the half of the cells that gain most
    assert float(change.max()) <= 0.3 * 0.8
    assert loss(moved) > loss(images)
    assert moved.amin() >= 0.1
    assert moved.amax() <= 0.9


def test_where_nothing_can_move_nothing_does() -> None:
    images = torch.full((1, 3, 16, 16), 0.5)
    moved = attacked(images, images, images, lambda seen: seen.square().sum(), 1.0, np.random.default_rng(0))
    assert torch.equal(moved, images)
