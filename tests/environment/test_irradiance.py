from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from rauca_core.contract import Camera, Finish, RaucaError, Weather
from rauca_core.environment.air import transmittance
from rauca_core.environment.irradiance import SEEN, Irradiance, Source, fit_place, optics_of, view_factor
from rauca_core.environment.paint_optics import PaintOptics
from rauca_core.environment.paint_surface import PaintSurface
from rauca_core.render import Pyramid, build_taps

SIZE, PIXELS = 64, 64
CLEAR, FOG = Weather("clear", 45.0), Weather("fog", 45.0, fog_density=80.0, fog_falloff=2.0)


@pytest.fixture
def surface(box_vehicle):
    return PaintSurface.of(box_vehicle, Pyramid.of(box_vehicle, SIZE))


def true_light(surface: PaintSurface) -> np.ndarray:
    """A sky, a sun from one side and the straight edge of a shadow, (P, 3)."""
    place, facing = surface.texel_positions.numpy(), surface.texel_normals.numpy()
    sun = np.maximum(facing @ [0.5, 0.6, 0.62], 0) * (place[:, 0] > 0.2)
    return 0.1 * (1 + facing[:, 2:]) * [0.8, 0.9, 1.1] + 0.3 * sun[:, None] * [1.1, 1.0, 0.8]


def view(vehicle, surface, azimuth, elevation=15.0, distance=8.0):
    turn, rise = np.radians([azimuth, elevation])
    eye = distance * np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
    center = np.array([0, 0, 0.75])
    camera = Camera.look_at(center + eye, center, 45, PIXELS, PIXELS)
    return camera, build_taps(vehicle, camera, surface.pyramid.size, 4, pyramid=surface.pyramid)


def place(vehicle, surface, weather, azimuths, noise=0.0):
    """The truth as an irradiance, and sources that it made."""
    optics = optics_of(vehicle, "own", weather)
    light = true_light(surface).astype(np.float32)
    truth = Irradiance(surface, optics, weather, light, np.ones(len(light), np.float32))
    rng, sources = np.random.default_rng(5), []
    for azimuth in azimuths:
        camera, taps = view(vehicle, surface, azimuth)
        A = truth.gain(taps, camera).numpy()
        A *= 1 + noise * rng.standard_normal(A.shape)
        sources.append(Source(camera, taps, A, np.full_like(A, 0.02), 0.0, f"at {azimuth}"))
    return truth, sources


def display_error(found, wanted):
    return np.abs((0.5 * found).clip(0, 1) ** (1 / 2.2) - (0.5 * wanted).clip(0, 1) ** (1 / 2.2))


@pytest.mark.parametrize("weather", [CLEAR, FOG, Weather("rain", 30.0, precipitation=60.0)])
def test_known_light_is_found_and_lights_a_camera_between_the_sources(box_vehicle, surface, weather):
    truth, sources = place(box_vehicle, surface, weather, range(0, 360, 45), noise=0.03)
    found = fit_place(sources, surface, truth.optics, weather)
    camera, taps = view(box_vehicle, surface, 70, 20.0, 7.0)
    solid = (taps.alpha > 0.98) & (found.known(taps).numpy() > 0.9)
    assert solid.sum() > 100
    error = display_error(found.gain(taps, camera).numpy(), truth.gain(taps, camera).numpy())[solid]
    assert np.median(error) < 0.01
    assert np.sqrt((error**2).mean()) < 0.03
    assert min(r.display_db for r in found.residuals) > 30


def test_more_views_average_noise_away(box_vehicle, surface, monkeypatch):
    monkeypatch.setattr("rauca_core.environment.irradiance.SPOT", 1.0)
    camera, taps = view(box_vehicle, surface, 45)
    errors = []
    for azimuths in ((20,), (20, 30, 40, 50, 60, 70, 80)):
        truth, sources = place(box_vehicle, surface, CLEAR, azimuths, noise=0.2)
        found = fit_place(sources, surface, truth.optics, CLEAR)
        seen = (taps.alpha > 0.98) & (found.known(taps).numpy() > 0.9)
        error = display_error(found.gain(taps, camera).numpy(), truth.gain(taps, camera).numpy())
        errors.append(np.sqrt((error[seen] ** 2).mean()))
    assert errors[1] < 0.75 * errors[0]


def test_one_source_fills_what_it_did_not_see_and_says_so(box_vehicle, surface):
    truth, sources = place(box_vehicle, surface, CLEAR, (30,))
    found = fit_place(sources, surface, truth.optics, CLEAR)
    behind, taps = view(box_vehicle, surface, 210)
    assert found.known(sources[0].taps).numpy()[sources[0].taps.alpha > 0.98].mean() > 0.95
    assert found.known(taps).numpy().mean() < 0.6
    A = found.gain(taps, behind)
    assert torch.isfinite(A).all()
    seen = found.texels[found.weight >= SEEN]
    assert found.texels.min() >= 0
    assert found.texels.max() <= seen.max() * 1.001


def test_a_spot_in_one_view_is_not_believed(box_vehicle, surface):
    truth, sources = place(box_vehicle, surface, CLEAR, range(0, 360, 30))
    spoilt = sources[3].A.copy()
    spoilt[len(spoilt) // 2 : len(spoilt) // 2 + 60] *= 4  # a lamp's mirror image, or the sun's on glass before paint
    with_spot = [*sources[:3], dataclasses.replace(sources[3], A=spoilt), *sources[4:]]
    found = fit_place(with_spot, surface, truth.optics, CLEAR)
    camera, taps = sources[3].camera, sources[3].taps
    solid = taps.alpha > 0.98
    error = display_error(found.gain(taps, camera).numpy(), truth.gain(taps, camera).numpy())[solid]
    assert np.sqrt((error**2).mean()) < 0.03
    assert found.residuals[3].spots > 2 * found.residuals[9].spots + 0.005


def test_glare_tells_nothing_of_the_light_below_it(box_vehicle, surface):
    """The sky mirrored in a bonnet is white whatever the paint: what a render has for A there is noise of any size."""
    truth, sources = place(box_vehicle, surface, CLEAR, range(0, 360, 45))
    clean = fit_place(sources, surface, truth.optics, CLEAR)
    camera, taps = sources[1].camera, sources[1].taps
    glare = np.arange(len(taps)) < len(taps) // 3
    noise = np.random.default_rng(3).uniform(0.0, 12.0, (int(glare.sum()), 3))
    A, B = sources[1].A.copy(), sources[1].B.copy()
    A[glare], B[glare] = noise, 3.0
    found = fit_place(
        [sources[0], dataclasses.replace(sources[1], A=A, B=B), *sources[2:]], surface, truth.optics, CLEAR
    )
    solid = taps.alpha > 0.98
    errors = [
        display_error(fit.gain(taps, camera).numpy(), truth.gain(taps, camera).numpy())[solid] for fit in (found, clean)
    ]
    assert np.sqrt((errors[0] ** 2).mean()) < 1.3 * np.sqrt((errors[1] ** 2).mean()) + 0.003
    assert found.residuals[1].pixels < clean.residuals[1].pixels


def test_darkness_and_views_without_paint_do_no_harm(box_vehicle, surface):
    truth, sources = place(box_vehicle, surface, CLEAR, (0, 90))
    camera, taps = view(box_vehicle, surface, 0, distance=400.0)
    far = Source(camera, taps, np.zeros((len(taps), 3)), np.zeros((len(taps), 3)))
    dark = [dataclasses.replace(s, A=s.A * 0) for s in sources]
    found = fit_place([*dark, far], surface, truth.optics, CLEAR)
    assert np.abs(found.texels).max() < 1e-4
    assert all(np.isfinite(r.display_db) for r in found.residuals)
    with pytest.raises(RaucaError, match="no view shows enough of the paint"):
        fit_place([far], surface, truth.optics, CLEAR)
    with pytest.raises(RaucaError, match="no view shows enough of the paint"):
        fit_place([], surface, truth.optics, CLEAR)


def test_a_coarse_light_texture_is_read_through_a_finer_map(box_vehicle, surface):
    truth, sources = place(box_vehicle, surface, CLEAR, range(0, 360, 45))
    found = fit_place(sources, surface, truth.optics, CLEAR)
    fine = PaintSurface.of(box_vehicle, Pyramid.of(box_vehicle, 4 * SIZE), SIZE)
    assert len(fine.light.texels) == len(found.texels)
    camera, taps = view(box_vehicle, surface, 60)
    _, finer = view(box_vehicle, fine, 60)
    one = found.gain(taps, camera).numpy()
    two = found.on(fine).gain(finer, camera).numpy()
    _, a, b = np.intersect1d(taps.pixels, finer.pixels, return_indices=True)
    whole = (taps.alpha[a] > 0.98) & (finer.alpha[b] > 0.98)
    assert whole.sum() > 100
    assert np.sqrt((display_error(one[a], two[b])[whole] ** 2).mean()) < 0.02
    # The matrix that a fit solves is what `levels` computes.
    values = np.random.default_rng(0).random((len(found.texels), 3)).astype(np.float32)
    assert np.allclose(fine.matrix @ values, fine.levels(torch.from_numpy(values)).numpy(), atol=1e-5)


def test_exposure_only_scales(box_vehicle, surface):
    truth, sources = place(box_vehicle, surface, CLEAR, (0,))
    camera, taps = sources[0].camera, sources[0].taps
    assert torch.allclose(truth.gain(taps, camera, 1.5), truth.gain(taps, camera) * 2**1.5)


# Blender 5.0, Cycles: a plane in a white world, base color 0.8 less black, over 0.8.
COSINES = np.array([0.04, 0.2487, 0.4991, 0.7496, 1.0])
FURNACE = {
    Finish(0.35, 0.5, 0.6): (0.3503, 0.6827, 0.8659, 0.9264, 0.9379),
    Finish(0.5, 0.1, 1.0): (0.179, 0.6802, 0.8862, 0.943, 0.9534),
    Finish(0.7, 0.25, 0.0): (0.9028, 0.9454, 0.9698, 0.9805, 0.9841),
    Finish(0.16, 0.5, 0.6): (0.216, 0.6195, 0.8608, 0.9261, 0.937),
}


@pytest.mark.parametrize("finish", list(FURNACE))
def test_the_angular_factor_is_that_of_the_renderer(finish):
    found = PaintOptics(finish)(COSINES, np.zeros(5))
    assert np.abs(found - FURNACE[finish])[1:].max() < 0.008
    assert abs(found[0] - FURNACE[finish][0]) < 0.02


def test_water_makes_what_faces_the_sky_smoother():
    dry, soaked = PaintOptics(Finish(0.5, 0.5, 0.0)), PaintOptics(Finish(0.5, 0.5, 0.0), 1.0)
    smooth, cosine = PaintOptics(Finish(0.16, 0.5, 0.0)), np.linspace(0.05, 1, 9)
    assert np.allclose(soaked(cosine, np.ones(9)), smooth(cosine, np.ones(9)))
    wall = soaked(cosine, np.zeros(9))
    low, high = np.sort([dry(cosine, np.zeros(9)), smooth(cosine, np.zeros(9))], axis=0)
    assert ((low - 1e-3 <= wall) & (wall <= high + 1e-3)).all()


def test_fog_is_beer_lamberts_and_thins_out_with_height():
    eye, point = np.array([0.0, 0.0, 1.0]), np.array([[10.0, 0.0, 1.0], [40.0, 0.0, 1.0]])
    even = Weather("even", 45.0, fog_density=100.0)
    assert np.allclose(transmittance(even, eye, point), np.exp([-0.6, -2.4]))
    assert np.allclose(transmittance(CLEAR, eye, point), 1)
    high = np.array([0.0, 0.0, 10.0])
    falling = dataclasses.replace(even, fog_falloff=5.0)
    mean = (1 - 2.0**-5) / (5 * np.log(2))  # of 2^(-5 z / 10 m) from the ground to 10 m
    assert np.allclose(transmittance(falling, high, np.array([[0.0, 0.0, 0.0]])), np.exp(-0.6 * mean), rtol=1e-3)
    clearing = dataclasses.replace(even, fog_distance=20.0)
    near, far = transmittance(clearing, eye, point)
    assert near == 1
    assert np.exp(-0.06 * 20) < far < np.exp(-0.06 * 17)


def test_factors_stay_within_bounds_from_every_side(box_vehicle, surface):
    for azimuth in (0, 44, 90):
        for elevation in (-10.0, 0.0, 89.0):
            camera, taps = view(box_vehicle, surface, azimuth, elevation)
            share = view_factor(taps, camera, surface, optics_of(box_vehicle, "car_paint", FOG), FOG)
            assert np.isfinite(share).all()
            assert (share >= 0).all()
            assert (share <= 1).all()


def test_what_stands_before_the_paint_is_no_light(box_vehicle, surface):
    truth, sources = place(box_vehicle, surface, CLEAR, range(0, 360, 45))
    shown = [np.where(np.arange(len(s.taps)) % 3 > 0, s.taps.alpha, 0) for s in sources]
    hidden = [
        dataclasses.replace(s, A=np.where(m[:, None] > 0, s.A, 0.0), shown=m)
        for s, m in zip(sources, shown, strict=True)
    ]
    found = fit_place(hidden, surface, truth.optics, CLEAR)
    camera, taps = view(box_vehicle, surface, 70)
    solid = (taps.alpha > 0.98) & (found.known(taps).numpy() > 0.9)
    error = display_error(found.gain(taps, camera).numpy(), truth.gain(taps, camera).numpy())[solid]
    assert np.sqrt((error**2).mean()) < 0.03
