from __future__ import annotations

import pytest
import torch

from rauca_core.environment.methods import transfer_light

SIZE = 20


@pytest.fixture
def frame():
    """Fog glow 0.1, diffuse light from 0.3 to 1, one mirrored sun; paint of a color."""
    paint = torch.zeros(1, SIZE, SIZE)
    paint[:, 4:16, 4:16] = 1.0
    albedo = torch.tensor([0.5, 0.2, 0.05])
    gain = torch.linspace(0.3, 1.0, SIZE).expand(3, SIZE, SIZE) * paint
    B = torch.full((3, SIZE, SIZE), 0.1)
    B[:, 8, 8] = 5.0
    return gain * albedo[:, None, None] + B, paint, albedo, gain


def test_the_reference_comes_back_and_the_sun_is_not_paint(frame):
    image, paint, albedo, gain = frame
    A, B = transfer_light(image, paint, albedo)
    assert torch.allclose(A * albedo[:, None, None] + B, image, atol=1e-6)
    assert (A[:, paint[0] == 0] == 0).all()
    assert (A[:, 8, 8] <= gain.max()).all()
    assert (B[:, 8, 8] > 4.5).all()
    assert (A - (gain - gain[:, paint[0] > 0].min())).abs()[:, paint[0] > 0].median() < 0.06
