"""Rain: as many drops as meteorology counts, hidden by what is nearer, named by a seed, affine in the paint."""

import itertools

import numpy as np
import pytest

from rauca_core.contract import Camera, Weather, rain

SIZE = 96
CAMERA = Camera.look_at(np.array([-7.0, -4.0, 1.6]), np.array([0.0, 0.0, 0.7]), 40, SIZE, SIZE)
FAR = np.full((SIZE, SIZE), 30.0, np.float32)
POUR = Weather("pour", 40, precipitation=90, wind_intensity=20)


def test_dry_weather_changes_nothing():
    image = np.random.default_rng(0).random((SIZE, SIZE, 3)).astype(np.float32)
    assert np.array_equal(rain.over(image, rain.streaks(Weather("dry", 40), CAMERA, FAR, 1)), image)


def test_rain_is_named_by_its_seed():
    first, again, other = (rain.streaks(POUR, CAMERA, FAR, seed).alpha for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert first.dtype == np.float32


def test_more_rain_covers_more():
    covered = [
        rain.streaks(Weather("w", 40, precipitation=p), CAMERA, FAR, 1).alpha.mean() for p in (0, 10, 30, 60, 100)
    ]
    assert covered[0] == 0.0
    assert all(a < b for a, b in itertools.pairwise(covered))


def test_extinction_is_the_integral_over_the_drop_sizes():
    """Marshall-Palmer's distribution added up drop by drop, at 25 mm/h."""
    diameter = np.linspace(1e-4, 12, 200_000)
    number = 8000 * np.exp(-4.1 * 25**-0.21 * diameter)
    area = np.pi / 4 * (diameter * 1e-3) ** 2
    assert rain.extinction(25.0) == pytest.approx(2 * (number * area).sum() * (diameter[1] - diameter[0]), rel=1e-3)


def test_drawn_drops_add_up_to_their_cross_section(monkeypatch):
    """Optical thickness of drawn streaks and haze, unthickened, is the extinction by cross-section times the way."""
    monkeypatch.setattr(rain, "STREAK_GAIN", rain.EXTINCTION_EFFICIENCY)
    thickness = [-np.log1p(-rain.streaks(POUR, CAMERA, FAR, seed).alpha).mean() for seed in range(6)]
    assert np.mean(thickness) == pytest.approx(rain.extinction(POUR.rain_rate_mm_h) * 30.0, rel=0.1)


def test_a_surface_hides_the_rain_behind_it():
    near = FAR.copy()
    near[:, :48] = 0.85
    seen, hidden = rain.streaks(POUR, CAMERA, FAR, 1).alpha, rain.streaks(POUR, CAMERA, near, 1).alpha
    assert np.array_equal(seen[:, 50:], hidden[:, 50:])
    assert hidden[:, :46].mean() < 0.1 * seen[:, :46].mean()


def test_rain_falls_down_and_drifts_with_the_wind():
    """Streaks correlate along the way they fall: straight down in calm air, slanted across the wind."""

    def slant(wind):
        side_on = Camera.look_at(np.array([0.0, -8.0, 1.5]), np.array([0.0, 0.0, 1.5]), 40, SIZE, SIZE)
        far = np.full((SIZE, SIZE), 8.0)
        alpha = rain.streaks(Weather("w", 40, precipitation=40, wind_intensity=wind), side_on, far, 3).alpha
        detail = alpha - alpha.mean()
        return [float((detail[4:, 8:-8] * detail[:-4, 8 - x : SIZE - 8 - x]).mean()) for x in (-4, 0, 4)]

    left, straight, right = slant(0)
    assert straight > 3 * max(left, right)
    left, straight, right = slant(60)
    assert right > left  # four rows down it is further along +x, the image's right


def test_affine_in_the_paint():
    rng = np.random.default_rng(1)
    A, B, x = (rng.random((SIZE, SIZE, 3)).astype(np.float32) for _ in range(3))
    drops = rain.streaks(POUR, CAMERA, FAR, 1)
    predicted = rain.over_gain(A, drops) * x + rain.over(B, drops)
    assert predicted == pytest.approx(rain.over(A * x + B, drops), abs=1e-5)


def test_sky_and_huge_rain_stay_finite():
    sky = np.full((SIZE, SIZE), np.inf, np.float16)
    drops = rain.streaks(Weather("w", -5, precipitation=100, wind_intensity=100), CAMERA, sky, 1)
    assert np.isfinite(drops.alpha).all()
    assert 0.9 < drops.alpha.min() <= drops.alpha.max() <= 1.0
    assert (drops.radiance > 0).all()
