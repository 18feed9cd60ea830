from __future__ import annotations

import numpy as np
import pytest
import torch

from rauca_core.contract import Camera
from rauca_core.environment.shading import plain_shading
from rauca_core.render import build_taps

SIZE = 48


@pytest.fixture
def camera():
    return Camera.look_at(np.array([5.0, 4.0, 3.0]), np.array([0, 0, 0.7]), 60, SIZE, SIZE)


def test_upright_faces_get_half_the_light_and_the_roof_all_of_it(box_vehicle, camera):
    plain = plain_shading(box_vehicle, camera)
    full = plain.coverage == 1
    sides = full & (plain.rest.amax(0, keepdim=True) == 0)
    assert sides.sum() > 100
    assert torch.allclose(plain.paint[sides], torch.tensor(0.5))
    roof = full & (plain.paint == 0)
    assert roof.sum() > 50
    color = 12.92 * 0.02 if 0.02 <= 0.0031308 else 1.055 * 0.02 ** (1 / 2.4) - 0.055
    assert torch.allclose(plain.rest[:, roof[0]], torch.tensor(color, dtype=torch.float32), atol=1e-5)


def test_coverage_is_the_taps(box_vehicle, camera):
    plain = plain_shading(box_vehicle, camera)
    taps = build_taps(box_vehicle, camera, 64, 2, filter="box", pattern="grid", thinning=0.0)
    assert np.abs(taps.coverage() - 2 * plain.paint[0].numpy()).mean() < 2e-2  # the mask's gutters, the sides' 0.5


def test_colors_and_textures(box_vehicle, camera):
    plain = plain_shading(box_vehicle, camera)
    colors = torch.rand(4, 3, 1, 1)
    images = plain.x_nr(colors)
    assert images.shape == (4, 3, SIZE, SIZE)
    assert torch.equal(images, plain.x_nr(colors.expand(4, 3, SIZE, SIZE)))
    assert (images[:, (plain.coverage == 0).expand(3, -1, -1)] == 0).all()
