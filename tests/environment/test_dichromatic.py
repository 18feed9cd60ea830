"""Light of one picture of a saturated paint: grey paint comes out grey, and mirror images stay where they are."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from rauca_core.contract.color import linear_to_srgb, srgb_to_linear, to_bytes
from rauca_core.environment.dichromatic import find_paint_color, split_colors
from rauca_core.environment.estimate import estimate_image
from rauca_core.environment.weights import load_extractor

SIZE = 96
TEAL = (0, 135, 168)


def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A (H, W), grey light on paint; B (H, W, 3), grey mirror images on it and a road around; the paint's mask."""
    rows, columns = np.mgrid[:SIZE, :SIZE] / SIZE
    mask = ((np.abs(rows - 0.5) < 0.25) & (np.abs(columns - 0.5) < 0.35)).astype(np.float32)
    A = mask * (0.3 + 0.9 * columns)
    mirrored = mask * (0.15 * (np.sin(9 * columns) > 0.3) + 0.02)
    around = (1 - mask) * (0.2 + 0.05 * np.sin(40 * rows))
    return A, np.repeat((mirrored + around)[..., None], 3, 2), mask


def pictured(paint: np.ndarray) -> np.ndarray:
    A, B, _ = scene()
    return to_bytes(linear_to_srgb(A[..., None] * paint + B))


def misses(light: tuple[np.ndarray, np.ndarray], x: float) -> float:
    """Mean squared error of the picture in grey paint of albedo x, on the paint, sRGB."""
    A, B, mask = scene()
    found = linear_to_srgb(light[0] * x + light[1])
    return float(((found - linear_to_srgb(A[..., None] * x + B))[mask > 0] ** 2).mean())


def test_the_shipped_extractor_paints_a_teal_vehicle_grey() -> None:
    mask, linear = scene()[2], srgb_to_linear(np.array(TEAL) / 255.0)
    light = estimate_image(pictured(linear), mask, TEAL, load_extractor()[0])
    grey = linear_to_srgb(light.A * 0.214 + light.B)[mask > 0]
    assert np.quantile(np.ptp(grey, axis=1), 0.9) < 0.06
    assert misses((light.A, light.B), 0.214) < 1e-3
    assert misses((light.A, light.B), 0.0) < 1e-3  # what is mirrored stays


@pytest.mark.parametrize("reference", [(140, 140, 140), (20, 20, 20)])
def test_a_grey_reference_leaves_the_maps_alone(reference: tuple[int, int, int]) -> None:
    A, B, mask = scene()
    maps = [torch.from_numpy(m).float() for m in (np.stack([A, A * 0.8, A * 1.1]), B.transpose(2, 0, 1))]
    r = torch.from_numpy(srgb_to_linear(np.array(reference) / 255.0)).float()
    found = split_colors(maps[0], maps[1], torch.from_numpy(mask)[None], r)
    assert all(torch.equal(one, two) for one, two in zip(found, maps, strict=True))


def test_maps_that_are_true_stay_so() -> None:
    A, B, mask = scene()
    maps = [torch.from_numpy(m).float() for m in (np.stack([A] * 3), B.transpose(2, 0, 1))]
    r = torch.from_numpy(srgb_to_linear(np.array(TEAL) / 255.0)).float()
    found = [m.permute(1, 2, 0).numpy() for m in split_colors(maps[0], maps[1], torch.from_numpy(mask)[None], r)]
    assert misses((found[0], found[1]), 0.214) < 1e-4
    assert np.allclose(found[0] * r.numpy() + found[1], A[..., None] * r.numpy() + B, atol=1e-3)


@pytest.mark.parametrize("paint", [TEAL, (180, 16, 20), (230, 190, 20), (140, 140, 140)])
def test_a_paints_color_is_told_by_the_picture(paint: tuple[int, int, int]) -> None:
    linear = srgb_to_linear(np.array(paint) / 255.0)
    found = srgb_to_linear(np.array(find_paint_color(pictured(linear), scene()[2])) / 255.0)
    assert np.abs(found / found.sum() - linear / linear.sum()).sum() < 0.25
    assert 0.5 < found.mean() / linear.mean() < 2
