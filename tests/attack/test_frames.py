"""Frames made ready show what Blender showed, and nothing is opened twice."""

from __future__ import annotations

import numpy as np
import torch

from rauca_core.attack import make_settings
from rauca_core.attack.frames import FrameStore, boxes_of, render_batch
from rauca_core.contract import Dataset
from rauca_core.contract.color import linear_to_srgb, srgb_to_linear
from rauca_core.environment import load_exact
from rauca_core.render import MipmappedTexture

SETTINGS = make_settings(map_size=64, samples=2)


def test_one_color_is_the_light_maps_own_image(dataset: Dataset) -> None:
    store = FrameStore(dataset, SETTINGS)
    batch = [store.ready(i) for i in range(len(store))]
    color = torch.tensor([0.7, 0.2, 0.4])
    images = render_batch(batch, MipmappedTexture(store.pyramid, color.expand(len(store.pyramid.texels), 3)))
    reference = srgb_to_linear(np.array(dataset.plan.reference_srgb) / 255)
    for image, frame, box in zip(images, store.frames, boxes_of(batch), strict=True):
        light = load_exact(dataset, frame.id)
        tapped = np.zeros(64 * 64, bool)
        tapped[batch[store.frames.index(frame)].taps.pixels] = True
        albedo = np.where(tapped.reshape(64, 64, 1), color.numpy(), reference)
        assert np.allclose(
            image.permute(1, 2, 0).numpy(), linear_to_srgb(light.A * albedo + light.B), atol=0.5 / 255 + 1e-5
        )
        assert tuple(box.tolist()) == frame.box_xyxy
        assert ((light.A > 0).any(2) <= tapped.reshape(64, 64)).all()


def test_weathers_share_taps_and_memory_is_bounded(dataset: Dataset) -> None:
    store = FrameStore(dataset, SETTINGS)
    first = store.ready(0)
    same_camera = [i for i, f in enumerate(store.frames) if f.view == store.frames[0].view]
    assert len(same_camera) == 2
    assert store.ready(same_camera[1]).taps is first.taps
    assert store.ready(0) is first
    assert len(list((dataset.folder / "taps").glob("*.safetensors"))) == 1
    store._budget = 1
    store.ready(1)
    assert store.ready(0) is not first
    assert torch.equal(store.ready(0).A, first.A)
