"""The sensor's gradients, noise and costs."""

from __future__ import annotations

import math

import pytest
import torch

from rauca_core.contract import RaucaError
from rauca_core.motion.sensor import Sensor, blur
from rauca_core.render import linear_to_srgb, srgb_to_linear

SMOOTH = Sensor(exposure_stops=0.5, full_well=2000, read_noise=5, vignetting=0.4, blur_px=0.8)


def light(size: int = 6, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    torch.manual_seed(0)
    return torch.rand(2, 3, size, size, dtype=dtype) * 0.5 + 0.05  # far from both ends, where clipping has a kink


def test_a_sensor_is_off_by_default():
    torch.testing.assert_close(Sensor()(light()), linear_to_srgb(light()), rtol=0, atol=0)
    once = light(dtype=torch.float32)
    torch.testing.assert_close(Sensor()(once), linear_to_srgb(once), rtol=0, atol=1e-6)


def test_gradients_of_all_that_is_smooth():
    assert torch.autograd.gradcheck(lambda x: SMOOTH(x, 3), light().requires_grad_(), atol=1e-6)


def test_quantization_and_jpeg_pass_gradients_straight_through():
    rough, plain = light(16).requires_grad_(), light(16).requires_grad_()
    weights = torch.rand(2, 3, 16, 16, dtype=torch.float64)
    seen = Sensor(bits=4, jpeg_quality=30)(rough)
    assert (seen - Sensor()(plain)).abs().max() > 0.02
    (seen * weights).sum().backward()
    (Sensor()(plain) * weights).sum().backward()
    torch.testing.assert_close(rough.grad, plain.grad)
    levels = Sensor(bits=4)(light(16)) * 15
    torch.testing.assert_close(levels, levels.round(), rtol=0, atol=1e-9)


def test_noise_is_that_of_counted_electrons():
    grey = torch.full((1, 3, 256, 256), 0.25)
    noisy = srgb_to_linear(Sensor(full_well=1000, read_noise=10)(grey, 1))
    expected = math.sqrt(0.25 / 1000 + (10 / 1000) ** 2)
    assert float(noisy.std()) == pytest.approx(expected, rel=0.02)
    assert float(noisy.mean()) == pytest.approx(0.25, rel=0.002)
    again, other = (srgb_to_linear(Sensor(full_well=1000, read_noise=10)(grey, seed)) for seed in (1, 2))
    torch.testing.assert_close(noisy, again, rtol=0, atol=0)
    difference = float((noisy - other).std())
    assert difference == pytest.approx(math.sqrt(2) * expected, rel=0.02)


@pytest.mark.parametrize("sensor", [Sensor(), SMOOTH, Sensor(full_well=300), Sensor(exposure_stops=2, vignetting=0.5)])
def test_one_pass_is_what_it_stands_for(sensor):
    """float32 on the CPU takes a kernel, with its own slope; float64 the formulas."""
    torch.manual_seed(1)
    quick = (torch.rand(2, 3, 24, 24) ** 3 * 1.3).requires_grad_()
    exact = quick.detach().double().requires_grad_()
    weights = torch.rand(2, 3, 24, 24)
    one, other = sensor(quick, 5), sensor(exact, 5)
    torch.testing.assert_close(one.double(), other, rtol=0, atol=2e-6)
    (one * weights).sum().backward()
    (other * weights).sum().backward()
    off = (quick.grad - exact.grad).abs() / exact.grad.abs().clamp(min=1)
    assert (
        float(off.quantile(0.99)) < 1e-3
    )  # at the knee of sRGB, and where it saturates, a slope may be the neighbor's
    assert float(exact.grad.abs().max()) > 0.1


def test_lenses_blur_alike_by_either_library():
    one = light(16)
    torch.testing.assert_close(blur(one, 1.3), blur(one, 1.3, with_torch=True), rtol=0, atol=1e-12)


def test_corners_lose_what_is_said_and_the_lens_keeps_the_light():
    grey = torch.full((1, 3, 65, 65), 0.25, dtype=torch.float64)
    seen = srgb_to_linear(Sensor(vignetting=0.4, blur_px=2.0)(grey))[0, 0]
    assert float(seen[32, 32]) == pytest.approx(0.25, rel=1e-3)
    assert float(seen[0, 0]) == pytest.approx(0.15, rel=0.02)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"read_noise": 3.0}, "read_noise is in electrons"),
        ({"jpeg_quality": 101}, "jpeg_quality must be from 0 to 100, not 101"),
        ({"vignetting": 1.0}, "vignetting must be from 0 to 0.95"),
    ],
)
def test_mistakes_are_one_line(wrong, told):
    with pytest.raises(RaucaError, match=told):
        Sensor(**wrong)
