"""Carrying a picture between UV layouts: exact where it can be, an area average where not, clean between islands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rauca_core.geometry.bake import bilinear, carry, fill_gaps, samples, samples_per_texel

SQUARE = np.array([[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]], np.float64)


def placed(scale: float, turn_deg: float = 0.0, at: tuple[float, float] = (0.5, 0.5)) -> np.ndarray:
    """The unit square, two triangles, scaled and turned about its middle, which lies ``at``."""
    angle = np.radians(turn_deg)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (SQUARE - 0.5) * scale @ rotation.T + at


def noise(size: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((size, size, 3)).astype(np.float32)


def on_surface(picture: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    """Colors at the same 5000 points of the faces, whatever the layout."""
    rng = np.random.default_rng(1)
    face, (a, b) = rng.integers(0, len(uvs), 5000), rng.random((2, 5000))
    a, b = np.where(a + b > 1, (1 - a, 1 - b), (a, b))
    weights = np.stack([1 - a - b, a, b], axis=1)
    return bilinear(picture, (weights[..., None] * uvs[face]).sum(axis=1))


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(-10 * np.log10(max(np.mean((one - other) ** 2), 1e-12)))


def test_the_same_layout_gives_the_same_texels():
    picture, uvs = noise(32), placed(0.8)
    result = carry(uvs, uvs, 32, lambda face, uv: bilinear(picture, uv), 32)
    assert psnr(on_surface(result.linear, uvs), on_surface(picture, uvs)) > 38
    assert np.abs(result.linear - picture)[6:26, 6:26].max() < 0.06
    assert result.overlap == 0


@given(st.floats(0, 360), st.floats(0.3, 0.7))
def test_a_ramp_is_carried_exactly_into_any_layout(turn, scale):
    def ramp(face, uv):
        return np.stack([uv[:, 0], uv[:, 1], 0.5 * uv[:, 0]], axis=1).astype(np.float32)

    source, target = placed(0.9), placed(scale, turn)
    result = carry(source, target, 48, ramp, 48)
    rng = np.random.default_rng(2)
    face, a = rng.integers(0, 2, 500), rng.dirichlet((1, 1, 1), 500)
    wanted = ramp(face, (a[..., None] * source[face]).sum(axis=1))
    found = bilinear(result.linear, (a[..., None] * target[face]).sum(axis=1))
    assert np.abs(found - wanted).max() < 0.02


def test_the_fit_beats_the_average_on_fine_detail():
    picture, source, target = noise(64), placed(0.9), placed(0.65, 30.0)
    result = carry(source, target, 128, lambda face, uv: bilinear(picture, uv), 64)
    total, count = np.zeros((128, 128, 3)), np.zeros((128, 128, 1))
    for found in samples(source, target, 512):
        np.add.at(total, (found.row // 4, found.column // 4), bilinear(picture, found.uv))
        np.add.at(count, (found.row // 4, found.column // 4), 1)
    average = fill_gaps((total / np.maximum(count, 1)).astype(np.float32), count[..., 0] > 0)
    truth = on_surface(picture, source)
    assert psnr(on_surface(result.linear, target), truth) > psnr(on_surface(average, target), truth) + 2


def test_a_smaller_picture_averages_over_area_in_linear_light():
    checks = np.indices((256, 256)).sum(axis=0)[..., None].repeat(3, axis=2) % 2
    uvs = placed(0.9)
    result = carry(uvs, uvs, 32, lambda face, uv: bilinear(checks.astype(np.float32), uv), 256)
    assert samples_per_texel(uvs, uvs, 256, 32) == 8
    assert np.abs(result.linear[4:28, 4:28] - 0.5).max() < 0.05


def test_each_sample_belongs_to_one_face():
    counts = np.zeros((64, 64), int)
    for found in samples(placed(1.0), placed(1.0), 64):  # the diagonal runs through sample points
        np.add.at(counts, (found.row, found.column), 1)
    assert (counts == 1).all()


def test_faces_on_top_of_each_other_are_told():
    source = np.concatenate([placed(0.4, at=(0.25, 0.5)), placed(0.4, at=(0.75, 0.5))])
    target = np.concatenate([placed(0.5), placed(0.5)])
    assert carry(source, target, 32, lambda face, uv: np.zeros((len(uv), 3), np.float32), 32).overlap == 1.0


@pytest.mark.parametrize("count", [256, 257])
def test_many_faces_on_top_of_each_other_are_told_and_keep_their_color(count):
    stacked = np.repeat(placed(0.8)[:1], count, axis=0)
    result = carry(stacked, stacked, 16, lambda face, uv: np.full((len(uv), 3), 0.75, np.float32), 16)
    assert result.overlap == 1.0
    assert np.allclose(result.linear[result.read], 0.75, atol=1e-3)


def test_faces_without_area_and_an_empty_layout_stay_finite():
    flat = np.concatenate([placed(0.5), np.full((1, 3, 2), 0.5), np.array([[(0, 0), (0.5, 0.5), (1, 1)]])])
    result = carry(flat, flat, 16, lambda face, uv: np.ones((len(uv), 3), np.float32), 16)
    assert np.isfinite(result.linear).all()
    assert np.abs(result.linear - 1).max() < 1e-3
    nothing = carry(flat[2:], flat[2:], 16, lambda face, uv: np.ones((len(uv), 3), np.float32), 16)
    assert np.isfinite(nothing.linear).all()
    assert not nothing.read.any()


def test_giving_up_stops_the_work():
    class GivenUpError(Exception):
        pass

    def give_up(share: float) -> None:
        if share > 0.5:
            raise GivenUpError

    with pytest.raises(GivenUpError):
        carry(placed(0.9), placed(0.9), 32, lambda face, uv: np.zeros((len(uv), 3), np.float32), 32, give_up)


def test_no_mip_level_meets_anything_but_paint():
    known = np.zeros((64, 64), bool)
    known[8:24, 8:24] = known[40:60, 33:50] = True
    picture = np.where(known[..., None], np.float32([0.9, 0.8, 0.1]), np.float32([-5, -5, -5]))
    filled = fill_gaps(picture, known, dilation=2)
    assert np.abs(filled - np.float32([0.9, 0.8, 0.1])).max() < 1e-5


def test_a_mip_cell_is_the_mean_of_its_painted_quarters():
    known = np.random.default_rng(3).random((32, 32)) < 0.2
    filled, picture = fill_gaps(noise(32), known, dilation=0), noise(32)
    assert (filled[known] == picture[known]).all()
    means, there = np.where(known[..., None], picture, 0), known
    while len(filled) > 1:
        half = len(filled) // 2
        filled = filled.reshape(half, 2, half, 2, 3).mean(axis=(1, 3))
        count = there.reshape(half, 2, half, 2).sum(axis=(1, 3))
        means = means.reshape(half, 2, half, 2, 3).sum(axis=(1, 3)) / np.maximum(count, 1)[..., None]
        there = count > 0
        assert np.abs(filled - means)[there].max() < 1e-5


def test_dilation_repeats_an_islands_edge():
    known = np.zeros((32, 32), bool)
    known[10:20, 4:8], known[10:20, 24:28] = True, True
    picture = np.zeros((32, 32, 3), np.float32)
    picture[:, :16] = 1
    filled = fill_gaps(picture, known, dilation=4)
    assert (filled[10:20, 8:12] == 1).all()
    assert (filled[10:20, 20:24] == 0).all()
    assert (filled[6:24, 0:4] == 1).all()  # up to the border


@pytest.mark.parametrize("size", [17, 24])
def test_sizes_that_halve_badly_are_filled_too(size):
    known = np.zeros((size, size), bool)
    known[3:5, 3:5] = True
    assert np.allclose(fill_gaps(np.full((size, size, 3), 0.3, np.float32), known), 0.3)
    assert np.isfinite(fill_gaps(np.zeros((size, size, 3), np.float32), np.zeros_like(known))).all()
