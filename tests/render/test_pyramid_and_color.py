"""Coverage-weighted mips, and the way from albedo to sRGB; gradients by finite differences."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from rauca_core.contract import RaucaError, color
from rauca_core.render import Pyramid, linear_to_srgb, srgb_to_linear


def test_levels_are_coverage_weighted_means() -> None:
    coverage = np.random.default_rng(0).random((16, 16)).astype(np.float32)
    coverage[coverage < 0.5] = 0
    pyramid = Pyramid(coverage)
    values = torch.rand(len(pyramid.texels), 3, dtype=torch.float64)
    levels = pyramid(values).numpy()
    uv_map = np.zeros((256, 3))
    uv_map[pyramid.texels] = values.numpy()
    uv_map = uv_map.reshape(16, 16, 3)
    for level, side in enumerate(pyramid.sizes):
        block = 16 // side
        share = coverage.reshape(side, block, side, block).sum((1, 3))
        total = (uv_map * coverage[..., None]).reshape(side, block, side, block, 3).sum((1, 3))
        slot = pyramid.slots[level]
        assert ((slot >= 0) == (share > 0)).all()
        wanted = total[slot >= 0] / share[slot >= 0, None]
        assert np.allclose(levels[slot[slot >= 0]], wanted, atol=1e-6)


def test_odd_sizes_stop_halving() -> None:
    pyramid = Pyramid(np.ones((20, 20), np.float32))
    assert pyramid.sizes == [20, 10, 5]
    assert pyramid(torch.ones(400, 3)).allclose(torch.ones(525, 3))


def test_map_round_trip_fills_gutters_from_the_nearest_paint() -> None:
    coverage = np.zeros((32, 32), np.float32)
    coverage[2:10, 2:10] = coverage[20:30, 20:30] = 1
    pyramid = Pyramid(coverage)
    uv_map = torch.rand(3, 32, 32)
    uv_map[:, 2:10, 2:10] = 0.9
    uv_map[:, 20:30, 20:30] = 0.1
    filled = pyramid.to_map(pyramid.from_map(uv_map))
    assert torch.equal(pyramid.from_map(filled), pyramid.from_map(uv_map))
    assert torch.allclose(filled[:, :12, :12], torch.tensor(0.9))
    assert torch.allclose(filled[:, 18:, 18:], torch.tensor(0.1))


def test_nothing_paintable_is_an_error() -> None:
    with pytest.raises(RaucaError, match="paintable"):
        Pyramid(np.zeros((16, 16), np.float32))


def test_decoding_is_the_contracts_transfer_function() -> None:
    """Encoding, at its ends too, is a hard case of `benchmarks.stability`."""
    srgb = torch.linspace(0, 1, 1001, requires_grad=True)
    assert np.allclose(srgb_to_linear(srgb).detach().numpy(), color.srgb_to_linear(srgb.detach().numpy()), atol=1e-6)
    assert torch.allclose(linear_to_srgb(srgb_to_linear(srgb)), srgb, atol=1e-5)
    outside = torch.tensor([-0.2, 0.01, 0.04045, 0.5, 1.0, 1.3], dtype=torch.float64, requires_grad=True)
    srgb_to_linear(outside).sum().backward()
    assert outside.grad.tolist() == pytest.approx(
        [0, 1 / 12.92, 1 / 12.92, 2.4 / 1.055 * ((0.5 + 0.055) / 1.055) ** 1.4, 2.4 / 1.055, 0]
    )
    assert torch.autograd.gradcheck(srgb_to_linear, torch.rand(50, dtype=torch.float64).requires_grad_())


def test_the_path_of_other_devices_climbs_alike() -> None:
    coverage = np.random.default_rng(1).random((32, 32)).astype(np.float32)
    coverage[coverage < 0.6] = 0
    pyramid = Pyramid(coverage)
    texels = torch.rand(len(pyramid.texels), 3, dtype=torch.float64, requires_grad=True)
    levels = pyramid(texels)
    parts = [texels]
    for step in pyramid._levels:
        parts.append(step(parts[-1]))
    other = torch.cat(parts)
    assert torch.allclose(levels, other, atol=1e-12)
    asked = torch.rand_like(levels)
    (one,), (two,) = (torch.autograd.grad(x, texels, asked) for x in (levels, other))
    assert torch.allclose(one, two, atol=1e-12)
    assert torch.autograd.gradcheck(pyramid, (texels,), fast_mode=True)


def test_decoding_by_table_is_as_exact_as_float32() -> None:
    srgb = torch.cat([torch.linspace(-0.1, 1.1, 100_003), torch.tensor([0.0, 1.0, 0.04045, float("nan")])])
    srgb.requires_grad_()
    exact = srgb.detach().double().requires_grad_()
    found, wanted = srgb_to_linear(srgb), srgb_to_linear(exact)
    assert torch.isnan(found[-1])
    assert (found[:-1].double() - wanted[:-1]).abs().max() < 1.5e-7
    found[:-1].sum().backward()
    wanted[:-1].sum().backward()
    # The curve has a corner at its knee; the table rounds it off over one interval.
    apart = (srgb.grad[:-1].double() - exact.grad[:-1]).abs()
    away = (exact.detach()[:-1] - 0.04045).abs() > 1 / 4096
    assert apart[away].max() < 1e-6
    assert apart.max() < 2e-3
