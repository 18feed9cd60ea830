"""What all defences promise: shapes, ranges, one image at a time, names, fingerprints and plain errors."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from rauca_core.contract import RaucaError
from rauca_core.study.defences import KINDS, make_defence
from rauca_core.study.defences.reference import BitDepth, Jpeg, Median

pytestmark = pytest.mark.usefixtures("nutnet_learnt")
NAMES = [
    *KINDS,
    "jpeg:quality=30",
    "lgs:block=7,overlap=3",
    "pad:percentile=50",
    "bits:depth=1",
    "median:size=5",
]


def noise(*shape: int, seed: int = 0) -> Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def half_noise(height: int, width: int, seed: int = 0) -> Tensor:
    """(1, 3, height, width): a ramp on the left, noise on the right."""
    image = torch.linspace(0, 1, height)[:, None].expand(3, height, width).clone()
    image[:, :, width // 2 :] = noise(3, height, width - width // 2, seed=seed)
    return image[None]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("shape", [(8, 8), (1, 1), (3, 40), (61, 97), (128, 128)])
def test_images_of_any_size_stay_finite_and_in_range(name: str, shape: tuple[int, int]) -> None:
    defence = make_defence(name)
    images = torch.cat([torch.zeros(1, 3, *shape), torch.ones(1, 3, *shape), half_noise(*shape)])
    defended = defence(images)
    assert defended.shape == images.shape
    assert defended.dtype == images.dtype
    assert bool(torch.isfinite(defended).all())
    assert 0 <= float(defended.min()) <= float(defended.max()) <= 1
    assert torch.equal(defended[0], images[0])  # nothing to defend in black


@pytest.mark.parametrize("name", NAMES)
def test_noise_is_changed_and_a_batch_is_its_images_one_by_one_every_time(name: str) -> None:
    defence = make_defence(name)
    images = torch.cat([half_noise(96, 96, seed) for seed in range(3)])
    before = images.clone()
    together = defence(images)
    assert torch.equal(images, before)
    assert name == "none" or float((together - images).abs().mean()) > 1e-3
    assert torch.equal(together, torch.cat([defence(image[None]) for image in images]))
    assert torch.equal(together, make_defence(name)(images))


@pytest.mark.parametrize("name", NAMES)
def test_a_name_makes_the_same_defence_again(name: str) -> None:
    defence = make_defence(name)
    again = make_defence(defence.name)
    assert defence.name.removesuffix(".0") == name  # defaults do not show
    assert defence == again
    assert defence.fingerprint == again.fingerprint


def test_fingerprints_tell_every_parameter_apart() -> None:
    names = [*KINDS, "jpeg:quality=74", "bits:depth=4", "median:size=5"]
    names += [f"lgs:{setting}" for setting in ("block=14", "overlap=4", "threshold=0.2", "smoothing=2")]
    names += [f"pad:{setting}" for setting in ("weight=0.4", "percentile=90", "kernel=40", "covered=0.6")]
    fingerprints = [make_defence(name).fingerprint for name in names]
    assert len(set(fingerprints)) == len(names)


@pytest.mark.parametrize("kind", KINDS.values())
def test_the_fingerprint_changes_with_the_implementation(kind: type, monkeypatch: pytest.MonkeyPatch) -> None:
    before = kind().fingerprint
    monkeypatch.setattr(kind, "version", kind.version + 1)
    assert kind().fingerprint != before


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("lsg", "there are none, lgs, pad, jpeg, bits, median"),
        ("", "there are none"),
        ("jpeg:qualty=50", "jpeg has quality=75"),
        ("none:x=1", "none has no parameters"),
        ("jpeg:quality", "quality: input should be a valid integer"),
        ("jpeg:quality=5,quality=6", "given twice"),
        ("lgs:threshold=nan", "threshold: input should be a finite number"),
        ("jpeg:quality=0", "greater than or equal to 1"),
        ("jpeg:quality=101", "less than or equal to 100"),
        ("bits:depth=9", "less than or equal to 8"),
        ("median:size=4", "size: value error, must be odd"),
        ("lgs:block=5", "overlap: value error, must be less than block, not 5"),
        ("pad:percentile=101", "less than or equal to 100"),
        ("pad:covered=1", "less than 1"),
    ],
)
def test_a_wrong_name_is_one_line_that_says_what_there_is(name: str, words: str) -> None:
    with pytest.raises(RaucaError) as caught:
        make_defence(name)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(
    "images",
    [
        torch.zeros(3, 16, 16),
        torch.zeros(1, 1, 16, 16),
        torch.zeros(1, 3, 16, 16, dtype=torch.uint8),
        torch.full((1, 3, 16, 16), 255.0),
        torch.full((1, 3, 16, 16), torch.nan),
    ],
    ids=["no batch", "grey", "bytes", "0..255", "NaN"],
)
def test_wrong_images_are_refused(name: str, images: Tensor) -> None:
    with pytest.raises(RaucaError, match=r"images|image 0"):
        make_defence(name)(images)


@given(st.integers(1, 100), st.integers(0, 99))
def test_jpeg_is_the_codec_s_own_round_trip(quality: int, seed: int) -> None:
    image = half_noise(33, 47, seed)
    pixels = (image[0] * 255).round().byte().permute(1, 2, 0).numpy()
    _, data = cv2.imencode(".jpg", cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
    expected = cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    found = Jpeg(quality=quality)(image)[0].permute(1, 2, 0) * 255
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-3)


@given(st.integers(1, 8))
def test_bit_depth_leaves_that_many_levels(depth: int) -> None:
    ramp = torch.linspace(0, 1, 4096).reshape(1, 1, 64, 64).expand(1, 3, 64, 64)
    found = BitDepth(depth=depth)(ramp)
    assert len(found.unique()) == 2**depth
    assert float((found - ramp).abs().max()) <= 0.5 / (2**depth - 1) + 1e-6


@pytest.mark.parametrize("size", [3, 5])
def test_the_median_is_opencv_s(size: int) -> None:
    pixels = (noise(29, 41, 3) * 255).round().byte().numpy()
    found = Median(size=size)(torch.from_numpy(pixels).permute(2, 0, 1)[None] / 255)[0].permute(1, 2, 0) * 255
    np.testing.assert_allclose(found.numpy(), cv2.medianBlur(pixels, size), atol=1e-3)


def test_a_median_lets_the_gradient_through() -> None:
    images = noise(1, 3, 12, 12).requires_grad_()
    Median()(images).sum().backward()
    assert images.grad is not None
    assert float(images.grad.sum()) == pytest.approx(3 * 12 * 12)
