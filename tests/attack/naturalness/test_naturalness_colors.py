"""CIELAB against published numbers, the palette's slope against finite differences, the bound in every dark corner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from rauca_core.attack.naturalness.colors import delta_e, delta_e_2000, distances, draw_back, lab, round_within
from rauca_core.attack.naturalness.palette import Palette, read_palette
from rauca_core.attack.paint_losses import near_reference
from rauca_core.contract import RaucaError

# B. Lindbloom's tables, D65, 2 degrees.
PRIMARIES = {
    (1, 0, 0): (53.2408, 80.0925, 67.2032),
    (0, 1, 0): (87.7347, -86.1827, 83.1793),
    (0, 0, 1): (32.2970, 79.1875, -107.8602),
    (1, 1, 1): (100.0, 0.0, 0.0),
    (0, 0, 0): (0.0, 0.0, 0.0),
}
# Sharma, Wu, Dalal: The CIEDE2000 color-difference formula (2005), Table 1; the pairs that tell implementations apart.
SHARMA = [
    ((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
    ((50.0, 3.1571, -77.2803), (50.0, 0.0, -82.7485), 2.8615),
    ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0000),
    ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
    ((50.0, 2.4900, -0.0010), (50.0, -2.4900, 0.0009), 7.1792),
    ((50.0, 2.4900, -0.0010), (50.0, -2.4900, 0.0011), 7.2195),
    ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
    ((50.0, 2.5, 0.0), (61.0, -5.0, 29.0), 22.8977),
    ((60.2574, -34.0099, 36.2677), (60.4626, -34.1751, 39.4387), 1.2644),
    ((22.7233, 20.0904, -46.6940), (23.0331, 14.9730, -42.5619), 2.0373),
    ((90.9257, -0.5406, -0.9208), (88.6381, -0.8985, -0.7239), 1.5381),
    ((6.7747, -0.2908, -2.4247), (5.8714, -0.0985, -2.2286), 0.6377),
    ((2.0776, 0.0795, -1.1350), (0.9033, -0.0636, -0.5514), 0.9082),
]
OLIVE = ("#1b2a1b", "#4b5320", "#8a7f5a", "#c8c0a0")
pytestmark = pytest.mark.stored


@pytest.mark.parametrize(("srgb", "expected"), PRIMARIES.items())
def test_lab_of_the_primaries(srgb: tuple[int, ...], expected: tuple[float, ...]) -> None:
    found = lab(torch.tensor([srgb], dtype=torch.float64))[0]
    np.testing.assert_allclose(found, expected, atol=0.02)


@pytest.mark.parametrize(("one", "other", "expected"), SHARMA)
def test_ciede2000_of_the_published_pairs(one: tuple[float], other: tuple[float], expected: float) -> None:
    pair = np.array([one, other])
    assert delta_e_2000(pair[:1], pair[1:])[0] == pytest.approx(expected, abs=5e-5)
    assert delta_e_2000(pair[1:], pair[:1])[0] == pytest.approx(expected, abs=5e-5)


def test_lab_has_the_slope_of_finite_differences() -> None:
    colors = torch.rand(40, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)) * 0.98 + 0.01
    colors[0] = 0.002  # on the straight part, beside black
    assert torch.autograd.gradcheck(lab, colors.requires_grad_(), eps=1e-7, atol=1e-4)


def test_black_and_a_color_that_is_its_own_reference_have_finite_gradients() -> None:
    for color in (0.0, 1.0, 0.5):
        paint = torch.full((5, 3), color, requires_grad=True)
        loss = near_reference(paint, lab(torch.full((5, 3), color)), torch.ones(5))
        loss.backward()
        assert float(loss.detach()) == pytest.approx(0, abs=1e-6)
        assert paint.grad is not None
        assert torch.isfinite(paint.grad).all()
    paint = torch.zeros(5, 3, requires_grad=True)
    near_reference(paint, lab(torch.ones(5, 3)), torch.ones(5)).backward()
    assert paint.grad is not None
    assert bool((paint.grad < 0).all())


def test_closeness_to_a_reference_against_finite_differences() -> None:
    generator = torch.Generator().manual_seed(2)
    paint, reference = torch.rand(2, 12, 3, dtype=torch.float64, generator=generator) * 0.9 + 0.05
    areas = torch.rand(12, dtype=torch.float64, generator=generator)
    near = lambda texels: near_reference(texels, lab(reference), areas)  # noqa: E731
    assert torch.autograd.gradcheck(near, paint.requires_grad_(), eps=1e-7, atol=1e-5)


def test_palette_shows_the_nearest_color() -> None:
    palette, free = Palette(OLIVE), torch.rand(500, 3, generator=torch.Generator().manual_seed(3))
    squares = ((free.numpy()[:, None] - palette.colors.numpy()[None]) ** 2).sum(-1)
    torch.testing.assert_close(palette.hard(free), palette.colors[squares.argmin(1)])
    allowed = torch.zeros(500, 4, dtype=torch.bool)
    allowed[:, 3] = True
    assert (palette.hard(free, allowed) == palette.colors[3]).all()


@pytest.mark.parametrize("colors", [OLIVE, ("#000000", "#ffffff"), ("#336699",)])
def test_hard_colors_have_the_slope_of_soft_ones(colors: tuple[str, ...]) -> None:
    palette = Palette(colors)
    palette.colors = palette.colors.double()
    generator = torch.Generator().manual_seed(4)
    free = torch.rand(20, 3, dtype=torch.float64, generator=generator).requires_grad_()
    asked = torch.rand(20, 3, dtype=torch.float64, generator=generator)
    allowed = torch.rand(20, len(colors), generator=generator) > 0.3
    allowed[:, 0] = True
    squares = (free[:, None] - palette.colors[None]).square().sum(-1).masked_fill(~allowed, torch.inf)
    soft = torch.softmax(-squares / palette.warmth, 1) @ palette.colors
    (wanted,) = torch.autograd.grad(soft, free, asked)
    (found,) = torch.autograd.grad(palette.hard(free, allowed), free, asked)
    torch.testing.assert_close(found, wanted)
    assert len(colors) > 1 or (found == 0).all()  # one color: nothing to choose, nothing infinite


def test_palettes_from_text_files_and_photographs(tmp_path: Path) -> None:
    assert read_palette("#102030,#A0B0C0", 4) == ("#102030", "#a0b0c0")
    (tmp_path / "p.txt").write_text("#102030\n\n#a0b0c0, #102030\n")
    assert read_palette(str(tmp_path / "p.txt"), 4) == ("#102030", "#a0b0c0")
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:, 20:40], pixels[:, 40:] = (90, 10, 200), (250, 250, 0)
    Image.fromarray(pixels).save(tmp_path / "photo.png")
    assert read_palette(str(tmp_path / "photo.png"), 3) == ("#000000", "#5a0ac8", "#fafa00")
    assert read_palette(str(tmp_path / "photo.png"), 9) == ("#000000", "#5a0ac8", "#fafa00")
    for bad, words in [
        ("#12345", "#rrggbb"), (str(tmp_path / "none.png"), "not found"), (str(tmp_path / "none.txt"), "not readable"),
    ]:  # fmt: skip
        with pytest.raises(RaucaError, match=words):
            read_palette(bad, 4)
    with pytest.raises(RaucaError, match="palette-colors"):
        read_palette(str(tmp_path / "photo.png"), 0)


@given(st.integers(0, 2**31), st.floats(0, 60), st.sampled_from(["any", "black", "white"]))
@settings(max_examples=60)
def test_no_color_stays_beyond_the_bound(seed: int, bound: float, kind: str) -> None:
    rng = np.random.default_rng(seed)
    home = {"any": rng.integers(0, 256, (50, 3)), "black": np.zeros((50, 3)), "white": np.full((50, 3), 255)}[kind]
    home = home.astype(np.uint8)
    colors = rng.random((50, 3))
    before = distances(colors, home / 255.0)
    moved = colors.copy()
    draw_back(moved, home / 255.0, bound)
    after = distances(moved, home / 255.0)
    assert ((moved >= 0) & (moved <= 1)).all()
    assert (after <= bound + 1e-9).all()
    assert (moved[before <= bound] == colors[before <= bound]).all()
    assert (after[before > bound] >= 0.99 * bound - 1e-9).all()  # no farther back than it has to go
    if bound == 0:
        assert np.array_equal(np.rint(moved * 255), home)
    rounded = round_within(moved, home, bound)
    assert (distances(rounded / 255.0, home / 255.0) <= bound + 1e-9).all()


def test_two_ways_to_a_distance_agree() -> None:
    """The kernel of the bound and torch's CIELAB share no code but the matrices."""
    one, other = np.random.default_rng(5).random((2, 200, 3))
    expected = delta_e(lab(torch.from_numpy(one)), lab(torch.from_numpy(other)))
    np.testing.assert_allclose(distances(one, other), expected, rtol=1e-9, atol=1e-9)
