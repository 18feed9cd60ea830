from __future__ import annotations

import pytest
import torch

from rauca_core.contract.color import TEST
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.methods import exact_render, plain_render, transfer_render
from rauca_core.environment.metrics import Error, albedos, measure, total


def test_errors_are_the_papers_on_the_paint():
    generator = torch.Generator().manual_seed(0)
    p, q = torch.rand(2, 3, 3, 8, 8, generator=generator) * 0.8 + 0.1
    paint = torch.zeros(1, 8, 8)
    paint[:, 2:5, 3:7] = 0.5
    found = Error.between(p, q, paint)
    seen, truth = p[..., 2:5, 3:7], q[..., 2:5, 3:7]
    assert found.mse == pytest.approx(torch.nn.functional.mse_loss(seen, truth).item(), rel=1e-5)
    assert found.mae == pytest.approx(torch.nn.functional.l1_loss(seen, truth).item(), rel=1e-5)
    assert found.bce == pytest.approx(torch.nn.functional.binary_cross_entropy(seen, truth).item(), abs=2e-4)
    assert found.psnr_db == pytest.approx(-10 * torch.tensor(found.mse).log10().item(), abs=1e-4)
    assert total([found, found]).mse == pytest.approx(found.mse)
    assert total([]).mse == Error.between(p, q, torch.zeros(1, 8, 8)).mse == 0


def test_methods_rank_as_they_must(dataset):
    frames = LightFrames([dataset.folder])
    everything = range(len(frames))
    exact = measure(frames, everything, lambda i, f: exact_render(f), TEST)
    transfer = measure(frames, everything, lambda i, f: transfer_render(f), TEST)
    plain = measure(frames, everything, lambda i, f: plain_render(f, frames.plain(i)), TEST)
    assert set(exact) == {"clear", "fog"}
    assert total(exact.values()).psnr_db == 100
    assert total(transfer.values()).mse < total(plain.values()).mse
    assert all(error.mse > 1e-4 for error in transfer.values())


def test_outside_the_vehicle_every_method_shows_the_frame(dataset):
    frames = LightFrames([dataset.folder])
    frame = frames.get(1)
    outside = (frame.vehicle[0] == 0) & (frames.plain(1).coverage[0] == 0)
    for render in (exact_render(frame), transfer_render(frame), plain_render(frame, frames.plain(1))):
        seen = render(albedos(TEST[:2]))
        assert torch.allclose(seen[..., outside], (frame.image / 255)[:, outside].expand(2, -1, -1), atol=0.01)
