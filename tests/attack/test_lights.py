from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from rauca_core.attack import make_settings
from rauca_core.attack.frames import FrameStore, boxes_of, render_batch
from rauca_core.attack.lights import published_light
from rauca_core.contract import Dataset, RaucaError
from rauca_core.environment.frames import LightFrames
from rauca_core.environment.methods import plain_render, published_render, transfer_render
from rauca_core.environment.weights import load_published
from rauca_core.render import MipmappedTexture, linear_to_srgb
from rauca_core.runtime.images import read_image
from tests.pretend_device import DEVICE, PretendDevice

SMALL: dict[str, Any] = {"map_size": 32, "samples": 4}


def in_color(dataset: Dataset, light: str, color: tuple[float, float, float]) -> tuple[FrameStore, torch.Tensor]:
    store = FrameStore(dataset, make_settings(light=light, **SMALL))
    texels = torch.tensor(color).expand(len(store.pyramid.texels), 3)
    return store, render_batch([store.ready(0)], MipmappedTexture(store.pyramid, texels))[0]


@pytest.mark.parametrize(("light", "method"), [("transfer", transfer_render), ("none", plain_render)])
def test_estimates_are_those_of_the_comparison(dataset: Dataset, light: str, method: Any) -> None:
    """The optimizer sees, on the paint, what the comparison of environments measures."""
    color = (0.7, 0.2, 0.05)
    store, found = in_color(dataset, light, color)
    frames = LightFrames([dataset.folder])
    extra = (frames.plain(0),) if light == "none" else ()
    wanted = method(frames.get(0), *extra)(torch.tensor(color)[None, :, None, None])[0]
    solid = frames.get(0).paint[0] == 255
    solid &= torch.nn.functional.avg_pool2d(solid.float()[None], 3, 1, 1)[0] > 0.99  # rasters differ on edges
    assert solid.sum() > 50
    assert (found - wanted)[:, solid].abs().mean() < 0.02
    assert store.ready(0).linear == (light != "none")


def test_the_extractor_gives_the_reference_back(dataset: Dataset) -> None:
    reference = np.array(dataset.plan.reference_srgb) / 255.0
    _, found = in_color(dataset, "ours", tuple(np.where(True, ((reference + 0.055) / 1.055) ** 2.4, 0)))
    image = read_image(dataset.frame_folder(dataset.frames()[0].id) / "image.png") / 255.0
    assert np.abs(found.permute(1, 2, 0).numpy() - image).mean() < 0.01


def test_the_published_extractor_lights_as_in_the_comparison(dataset: Dataset, weights: Path) -> None:
    """A color per pixel, and edges, too: all that the texture reaches is on one raster here."""
    frames = LightFrames([dataset.folder])
    frame, plain, net = frames.get(0), frames.plain(0), load_published(weights)
    light = published_light(net, frame.image.permute(1, 2, 0).numpy(), frame.vehicle.float() / 255, plain)
    albedo = torch.rand(3, *frame.image.shape[1:], generator=torch.Generator().manual_seed(1))
    A, B = (torch.from_numpy(m).permute(2, 0, 1) for m in (light.A, light.B))
    found = (A * linear_to_srgb(albedo) + B).clamp(0, 1)
    torch.testing.assert_close(found, published_render(net, frame, plain)(albedo[None])[0], atol=1e-6, rtol=0)


def test_the_published_extractor_needs_weights_of_its_own(dataset: Dataset, weights: Path, tmp_path: Path) -> None:
    for extractor, told in ((None, "needs weights"), (tmp_path / "none", "no such weights")):
        with pytest.raises(RaucaError, match=told):
            FrameStore(dataset, make_settings(light="published", extractor=extractor, **SMALL))
    weights.write_bytes(weights.read_bytes()[:-1] + b"x")
    with pytest.raises(RaucaError, match="is not the file that its card describes"):
        load_published(weights)


@pytest.mark.parametrize("light", ["ours", "published"])
def test_an_extractor_infers_on_the_device_that_is_named(dataset: Dataset, light: str, weights: Path) -> None:
    chosen = make_settings(light=light, extractor=weights if light == "published" else None, **SMALL)
    here = FrameStore(dataset, chosen).ready(0)
    with PretendDevice():
        there = FrameStore(dataset, chosen, DEVICE).ready(0)
    assert there.A.device.type == there.B.device.type == "cpu"  # where frames wait for their steps
    torch.testing.assert_close((there.A, there.B), (here.A, here.B), atol=1e-5, rtol=0)


LIGHTS = [{"light": light} for light in ("exact", "ours", "published", "transfer", "none")]
SAMPLERS = [{"sampler": name} for name in ("bilinear", "trilinear", "tensor-traversal", "uv-traversal")]


@pytest.mark.parametrize("chosen", [*LIGHTS, *SAMPLERS], ids=lambda chosen: next(iter(chosen.values())))
def test_every_light_and_sampler_lets_gradients_through(
    dataset: Dataset, chosen: dict[str, str], weights: Path
) -> None:
    extractor = weights if chosen.get("light") == "published" else None
    store = FrameStore(dataset, make_settings(**chosen, extractor=extractor, **SMALL))
    texels = torch.full((len(store.pyramid.texels), 3), 0.4, requires_grad=True)
    batch = [store.ready(i) for i in range(3)]
    images = render_batch(batch, MipmappedTexture(store.pyramid, texels))
    images.square().sum().backward()
    assert texels.grad is not None
    assert torch.isfinite(texels.grad).all()
    assert texels.grad.abs().sum() > 0
    assert 0 <= images.min() <= images.max() <= 1
    assert boxes_of(batch).shape == (3, 4)
