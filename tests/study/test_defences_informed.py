"""Attacks that know of a defence: stand-ins are near what they stand for, and what they find works."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from rauca_core.detect import DensePredictions, Detections
from rauca_core.study.assessment import Defended, Score
from rauca_core.study.defences import KINDS, make_defence
from rauca_core.study.defences.heat_maps import smooth_heat
from rauca_core.study.defences.informed import DefendedDetector
from rauca_core.study.defences.pad import Pad
from rauca_core.study.defences.smooth_jpeg import smooth_jpeg

pytestmark = pytest.mark.usefixtures("nutnet_learnt")


def picture(seed: int = 0, size: int = 96) -> Tensor:
    """(1, 3, S, S): smooth colors with a sharp square of texture, as a car in camouflage is."""
    rng = np.random.default_rng(seed)
    smooth = cv2.GaussianBlur(rng.random((size, size, 3)).astype(np.float32), (0, 0), 9)
    smooth = (smooth - smooth.min()) / np.ptp(smooth) * 0.6 + 0.2
    texture = cv2.resize(rng.random((12, 12, 3)).astype(np.float32), (36, 36), interpolation=cv2.INTER_NEAREST)
    smooth[30:66, 24:60] = texture
    return torch.from_numpy(np.ascontiguousarray(smooth.transpose(2, 0, 1)))[None]


class Linear:
    """A detector whose score is a fixed pattern's product with the picture: what moves it is known."""

    class_names, name, fingerprint = ("car",), "linear", "f00d"

    def __init__(self, pattern: Tensor) -> None:
        self.pattern = pattern

    def to(self, device: torch.device | str) -> Linear:
        return self

    def dense(self, images: Tensor) -> DensePredictions:
        score = (images * self.pattern).sum((1, 2, 3))[:, None]
        return DensePredictions(torch.zeros(len(images), 1, 4), score, score[..., None])

    def detect(self, images: Tensor, score_threshold: float = 0, iou_threshold: float = 0.45) -> list[Detections]:
        raise NotImplementedError


@pytest.mark.parametrize("quality", [30, 75, 95])
@pytest.mark.parametrize("size", [96, 61])
def test_smooth_jpeg_is_near_the_codec(quality: int, size: int) -> None:
    images = picture()[..., :size]
    exact, smooth = make_defence(f"jpeg:quality={quality}")(images), smooth_jpeg(images, quality)
    assert (smooth - exact).abs().mean() < 0.25 * (exact - images).abs().mean() + 1 / 255
    assert (smooth - exact).square().mean() < 0.35 * (exact - images).square().mean() + 1e-5


def test_the_smooth_heat_of_pad_lies_where_its_own_does() -> None:
    pad, images = Pad(), picture(size=128)
    pixels = (images[0] * 255).round().byte().permute(1, 2, 0).numpy()
    own, smooth = pad.heat(pixels), smooth_heat(images, pad.weight)[0, 0].numpy()
    assert np.corrcoef(own.ravel(), smooth.ravel())[0, 1] > 0.8
    inside = np.zeros_like(own, bool)
    inside[34:62, 28:56] = True
    assert smooth[inside].mean() > smooth[~inside].mean() + 0.3


@pytest.mark.parametrize("name", [*KINDS, "lgs:threshold=0.3", "jpeg:quality=30"])
def test_the_detector_sees_the_defence_itself_and_the_gradient_is_finite(name: str) -> None:
    defence, images = make_defence(name), picture().requires_grad_()
    pattern = torch.randn(3, 96, 96, generator=torch.Generator().manual_seed(1))
    found = DefendedDetector(Linear(pattern), defence).dense(images)
    score = found.objectness.sum()
    assert float(score.detach()) == pytest.approx(float((defence(images.detach()) * pattern).sum()), abs=1e-2)
    score.backward()
    assert images.grad is not None
    assert bool(torch.isfinite(images.grad).all())
    assert float(images.grad.abs().sum()) > 0


@pytest.mark.parametrize("name", ["lgs", "median", "jpeg:quality=40", "pad", "bits:depth=2", "nutnet"])
def test_who_knows_of_a_defence_gets_farther_behind_it(name: str) -> None:
    """Sixteen signed steps against the detector behind the defence, on the texture alone, and against the bare one."""
    defence = make_defence(name)
    # Fine stripes, which darkening and medians take away, on a slow wave, which they leave; JPEG takes of all noise.
    y, x = torch.meshgrid(torch.arange(96.0), torch.arange(96.0), indexing="ij")
    stripes = (2 * ((x % 2) - 0.5) + 0.7 * torch.sin(y / 6)).expand(3, 96, 96)
    noise = torch.randn(3, 96, 96, generator=torch.Generator().manual_seed(0))
    pattern = (noise if name.startswith("jpeg") else stripes).clone()
    pattern[:, :30], pattern[:, 66:], pattern[:, :, :24], pattern[:, :, 60:] = 0, 0, 0, 0
    detector = Linear(pattern)

    def attacked(through: Linear | DefendedDetector) -> float:
        best, images = np.inf, picture()
        for _ in range(16):
            images = images.detach().requires_grad_()
            through.dense(images).objectness.sum().backward()
            assert images.grad is not None
            step = images.grad.sign() * (pattern != 0)
            images = (images.detach() - 0.04 * step).clamp(0, 1)
            best = min(best, float((defence(images) * pattern).sum()))
        return best

    unaware, informed = attacked(detector), attacked(DefendedDetector(detector, defence))
    assert informed <= unaware + 1e-3 * abs(unaware)
    if name in ("lgs", "median", "jpeg:quality=40"):
        assert informed < unaware - 0.05 * abs(unaware)


def test_an_attack_that_knows_more_and_gets_less_far_failed() -> None:
    score = Score(0.4, 0.3, 0.5, 0.4, 8)
    defended = Defended(score, score, score, score, dataclasses.replace(score, ap=0.5))
    assert defended.attack_failed
    assert not dataclasses.replace(defended, informed=score).attack_failed
    assert not dataclasses.replace(defended, informed=None).attack_failed
