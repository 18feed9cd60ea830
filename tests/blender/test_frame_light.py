"""A frame's light: exposed for shade, never for the vehicle's sake, not at night; edges of paint as annotated."""

from __future__ import annotations

import numpy as np
import pytest

from blender_addon.scene.frame import expose
from blender_addon.scene.light_maps import refine_edges
from rauca_core.contract.exposure import MOST_STOPS, TARGET, metered_stops
from rauca_core.contract.semantics import CLASS_IDS, TARGET_INSTANCE

SIZE = 20


def street(radiance: float, paint: float = 0.5, sky: float = 5.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sky above a road with a vehicle on it: image, semantic ids, instance ids."""
    image = np.full((SIZE, SIZE, 3), radiance, np.float32)
    semantic = np.full((SIZE, SIZE), CLASS_IDS["road"], np.uint8)
    instances = np.zeros((SIZE, SIZE), np.uint8)
    image[:8], semantic[:8] = sky, CLASS_IDS["sky"]
    image[10:18, 2:18], semantic[10:18, 2:18], instances[10:18, 2:18] = paint, CLASS_IDS["paint"], TARGET_INSTANCE
    return image, semantic, instances


def test_shade_is_opened_up_in_part_and_sun_is_left():
    assert metered_stops(*street(TARGET), 45.0) == 0.0
    assert metered_stops(*street(4 * TARGET), 45.0) == 0.0
    shaded = street(TARGET / 4)
    stops = metered_stops(*shaded, 45.0)
    assert stops == pytest.approx(1.5, abs=0.01)
    assert TARGET / 4 < np.median(expose(shaded[0], stops)[shaded[2] == 0][-20:]) < TARGET
    assert metered_stops(*street(1e-9), 45.0) == MOST_STOPS


def test_neither_paint_nor_sky_is_metered():
    assert len({metered_stops(*street(0.02, paint, sky), 45.0) for paint in (0.0, 0.9) for sky in (0.1, 50.0)}) == 1


def test_nights_stay_dark_and_dusk_is_between():
    stops = [metered_stops(*street(0.005), altitude) for altitude in (10, 0, -3, -6, -30)]
    assert stops[0] == stops[1] > stops[2] > stops[3] == stops[4] == 0.0


def test_a_vehicle_that_fills_the_frame_has_the_weathers_exposure():
    image, semantic, instances = street(0.001)
    instances[:] = TARGET_INSTANCE
    assert metered_stops(image, semantic, instances, 45.0) == 0.0


def test_edges_take_their_coverage_from_the_annotation():
    rng = np.random.default_rng(0)
    rows, columns = np.mgrid[:40, :40]
    coverage = np.clip((columns - 0.3 * rows - 5.3) / 2 + 0.5, 0, 1).astype(np.float32)
    light = (0.4 + 0.004 * rows)[..., None] * np.array([1.0, 0.9, 0.7])
    truth = coverage[..., None] * light
    edge = (coverage > 0) & (coverage < 1)
    sampled = np.where(edge, rng.binomial(8, coverage) / 8, coverage)
    gain = (sampled[..., None] * light).astype(np.float32)

    refined = refine_edges(gain, coverage)
    assert np.array_equal(refined[~edge], gain[~edge])
    assert np.square(refined - truth)[edge].mean() < 0.5 * np.square(gain - truth)[edge].mean()
    # A mask of True and False has no edges.
    assert np.array_equal(refine_edges(gain, coverage > 0), gain)
