"""The fog's glow, from sources that are composed of known light, dimming and glow."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rauca_core.contract import Camera, Weather
from rauca_core.environment.views import fog_glow
from rauca_core.environment.views.fog_glow import FogGlow
from rauca_core.environment.views.lens import FAR_M, Lens

SIZE = 96
FOG = Weather("fog", sun_altitude_angle=40.0, sun_azimuth_angle=70.0, fog_density=60.0)


def look(azimuth_deg: float, metres: float) -> Lens:
    """A camera 3 m above the ground that looks at the middle of the place."""
    around = np.radians(azimuth_deg)
    eye = np.array([np.cos(around) * metres, np.sin(around) * metres, 3.0])
    return Lens.of(Camera.look_at(eye, np.zeros(3), 60.0, SIZE, SIZE))


def rays_of(lens: Lens) -> NDArray[np.float64]:
    """(H, W, 3) directions of unit depth."""
    x, y = np.meshgrid(np.arange(SIZE) + 0.5, np.arange(SIZE) + 0.5)
    return np.stack([x, y, np.ones_like(x)], -1) @ lens.rays.T


def depth_of_ground(lens: Lens) -> NDArray[np.float32]:
    """(H, W) metres along z to the plane z = 0, the sky's above its horizon."""
    down = -rays_of(lens)[..., 2]
    return np.where(down > 1e-2, lens.eye[2] / np.maximum(down, 1e-2), FAR_M).astype(np.float32)


def paint_of_ground(lens: Lens, depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """(H, W, 3) linear light of the ground, a smooth pattern; the sky's even."""
    points = lens.eye + rays_of(lens) * depth[..., None]
    waves = 0.3 + 0.2 * np.sin(points[..., :1] * 0.7) * np.cos(points[..., 1:2] * 0.5)
    return np.where((depth < FAR_M)[..., None], waves * [1.0, 0.9, 0.8], 0.5).astype(np.float32)


def glow_of(lens: Lens) -> NDArray[np.float64]:
    """(H, W, 3) S: warm, and brighter towards the sun."""
    rays = rays_of(lens)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    up, around = np.radians([FOG.sun_altitude_angle, FOG.sun_azimuth_angle])
    sun = [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]
    near = np.clip(rays @ np.array(sun), 0, 1)[..., None]
    return (0.4 + 0.5 * near) * [1.0, 0.9, 0.75]


def in_fog(lens: Lens) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Depth (H, W), light without fog and B in it, (H, W, 3)."""
    depth = depth_of_ground(lens)
    clear = paint_of_ground(lens, depth)
    length = depth * np.linalg.norm(rays_of(lens), axis=-1)
    left = np.where(depth < FAR_M, np.exp(-FOG.extinction * length), 1.0)[..., None]
    return depth, clear, (left * clear + (1 - left) * glow_of(lens)).astype(np.float32)


def test_the_glow_is_found_from_two_distances_and_taken_out() -> None:
    lenses = [look(azimuth, metres) for azimuth in range(0, 360, 45) for metres in (6.0, 12.0)]
    seen = [in_fog(lens) for lens in lenses]
    fog = FogGlow.of(FOG, lenses, np.stack([depth for depth, _, _ in seen]), np.stack([B for _, _, B in seen]))
    assert fog is not None
    new = look(20.0, 9.0)  # between the sources
    depth, clear, light = in_fog(new)
    left, glow = fog.at(new, depth)
    ground = depth < 40.0
    missed = np.abs(clear * left[..., None] + glow - light)[ground]
    assert missed.max() < 0.01
    assert missed.mean() < 0.1 * np.abs(light - clear)[ground].mean()  # of what would be missing without


def test_a_glow_brighter_than_what_is_seen_is_drawn_down(monkeypatch: pytest.MonkeyPatch) -> None:
    """A wet road mirrors the low sun towards the far cameras alone: that looks like glow, and is not."""
    lenses = [look(azimuth, metres) for azimuth in range(0, 360, 45) for metres in (6.0, 12.0)]
    seen = [in_fog(lens) for lens in lenses]
    depths, light = np.stack([depth for depth, _, _ in seen]), np.stack([B for _, _, B in seen])
    light[1::2] += np.float32(0.4)
    light[:, ::2] *= np.float32(0.3)  # dark stripes, darker than that glow

    def darker() -> float:
        """The mean of what the glow exceeds the light by."""
        fog = FogGlow.of(FOG, lenses, depths, light)
        assert fog is not None
        return float(
            np.mean([np.maximum(fog.at(lens, depths[n])[1] - light[n], 0).mean() for n, lens in enumerate(lenses)])
        )

    bounded = darker()
    monkeypatch.setattr(fog_glow, "DARKER", 0.0)
    assert darker() > 1.2 * bounded


def test_the_sky_has_its_glow_already() -> None:
    fog = FogGlow(FOG, np.ones((5, 3)))
    lens = look(0.0, 8.0)
    left, glow = fog.at(lens, np.full((SIZE, SIZE), FAR_M, np.float32))
    assert (left == 1).all()
    assert (glow == 0).all()


@pytest.mark.parametrize("density", [1.0, 100.0])
def test_extremes_are_finite(density: float) -> None:
    weather = Weather("fog", sun_altitude_angle=2.0, fog_density=density)
    lenses = [look(0.0, 6.0), look(10.0, 12.0)]
    depths = np.stack([depth_of_ground(lens) for lens in lenses])
    fog = FogGlow.of(weather, lenses, depths, np.zeros((2, SIZE, SIZE, 3), np.float32))
    assert fog is not None
    left, glow = fog.at(lenses[0], depths[0])
    assert np.isfinite(left).all()
    assert left.min() > 0
    assert (glow == 0).all()  # black light has no glow


def test_without_fog_or_a_second_view_there_is_nothing_to_take_out() -> None:
    lens = look(0.0, 6.0)
    depths, light = depth_of_ground(lens)[None], np.zeros((1, SIZE, SIZE, 3), np.float32)
    assert FogGlow.of(FOG, [lens], depths, light) is None
    both = np.concatenate([depths, depths]), np.concatenate([light, light])
    assert FogGlow.of(Weather("clear", sun_altitude_angle=45.0), [lens, lens], *both) is None
    night = Weather("night", sun_altitude_angle=-30.0, fog_density=60.0)
    assert FogGlow.of(night, [lens, look(10.0, 12.0)], *both) is None  # lamps do not glow alike everywhere
