"""The tap cache: shared, verified, rebuilt, warmed."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rauca_core.contract import Camera, RaucaError, Vehicle
from rauca_core.render import FacetSettings, PatternSettings, Sampler, TapCache, Taps, TapSettings, build_taps

SETTINGS = TapSettings(64, samples=2)


def view(azimuth: float) -> Camera:
    eye = np.array([6 * np.cos(azimuth), 6 * np.sin(azimuth), 2.0])
    return Camera.look_at(eye, np.array([0.0, 0.0, 0.7]), 50, 48, 40)


def same(a: Taps, b: Taps) -> bool:
    arrays = zip((a.pixels, a.alpha, *vars(a.rows).values()), (b.pixels, b.alpha, *vars(b.rows).values()), strict=True)
    return all(np.array_equal(x, y) for x, y in arrays if isinstance(x, np.ndarray))


EVERY = [*(replace(SETTINGS, sampler=sampler) for sampler in Sampler), FacetSettings(texture_size=5)]


@pytest.mark.parametrize("settings", EVERY)
def test_cache_returns_what_would_be_built(
    box_vehicle: Vehicle, tmp_path: Path, settings: TapSettings | FacetSettings
) -> None:
    built = settings.build(box_vehicle, view(0), settings.pyramid(box_vehicle))
    assert same(TapCache(tmp_path, box_vehicle, settings).get(view(0)), built)
    assert same(TapCache(tmp_path, box_vehicle, settings).get(view(0)), built)  # from disk


def test_frames_of_one_camera_share_an_entry(box_vehicle: Vehicle, tmp_path: Path) -> None:
    cache = TapCache(tmp_path, box_vehicle, SETTINGS)
    first = cache.get(view(0))
    (file,) = tmp_path.iterdir()
    written = file.stat().st_mtime_ns
    nudged = replace(view(0), t=view(0).t + 1e-13)
    assert cache.get(nudged) is first
    TapCache(tmp_path, box_vehicle, SETTINGS).get(nudged)
    assert file.stat().st_mtime_ns == written


def test_a_view_without_paint_is_built_once(box_vehicle: Vehicle, tmp_path: Path) -> None:
    away = Camera.look_at(np.array([20.0, 0.0, 2.0]), np.array([40.0, 0.0, 2.0]), 50, 48, 40)
    assert len(TapCache(tmp_path, box_vehicle, SETTINGS).get(away)) == 0
    (file,) = tmp_path.iterdir()
    written = file.stat().st_ino, file.stat().st_mtime_ns
    TapCache(tmp_path, box_vehicle, SETTINGS).get(away)
    assert (file.stat().st_ino, file.stat().st_mtime_ns) == written


@pytest.mark.parametrize("at", [10, 300, -5, None])
def test_a_flipped_bit_or_a_lost_end_is_found_and_repaired(
    box_vehicle: Vehicle, tmp_path: Path, at: int | None
) -> None:
    first = TapCache(tmp_path, box_vehicle, SETTINGS).get(view(0))
    (file,) = tmp_path.iterdir()
    damaged = bytearray(file.read_bytes())
    if at is not None:
        damaged[at] ^= 4
    file.write_bytes(damaged[: None if at else 1000])
    with pytest.raises(RaucaError, match="remove the file"):
        Taps.load(file, file.stem)
    assert same(TapCache(tmp_path, box_vehicle, SETTINGS).get(view(0)), first)
    assert same(Taps.load(file, file.stem), first)


def test_an_entry_under_another_name_is_refused(box_vehicle: Vehicle, tmp_path: Path) -> None:
    cache = TapCache(tmp_path, box_vehicle, SETTINGS)
    cache.get(view(0))
    (file,) = tmp_path.iterdir()
    with pytest.raises(RaucaError, match="another view"):
        Taps.load(file, "another")


def test_everything_the_taps_depend_on_is_in_the_key(box_vehicle: Vehicle, tmp_path: Path) -> None:
    for settings in (
        SETTINGS,
        replace(SETTINGS, samples=3),
        replace(SETTINGS, filter="box"),
        replace(SETTINGS, pattern="grid"),
        replace(SETTINGS, thinning=0.0),
        replace(SETTINGS, size=32),
        FacetSettings(texture_size=4),
        FacetSettings(texture_size=5),
    ):
        TapCache(tmp_path, box_vehicle, settings).get(view(0))
    TapCache(tmp_path, box_vehicle, SETTINGS).get(view(0.1))
    TapCache(tmp_path, box_vehicle, SETTINGS).get(replace(view(0), width=47))
    box_vehicle.positions[0, 0] += 0.1
    TapCache(tmp_path, box_vehicle, SETTINGS).get(view(0))
    assert len(list(tmp_path.iterdir())) == 11


@pytest.mark.parametrize(
    ("part", "change"), [("normals", lambda n: np.full_like(n, 3**-0.5)), ("paint_mask", lambda m: np.minimum(m, 160))]
)
def test_taps_are_read_anew_where_the_vehicle_changed(
    box_vehicle: Vehicle, tmp_path: Path, part: str, change: Callable[[np.ndarray], np.ndarray]
) -> None:
    settings = PatternSettings(16, 0.5, samples=2)
    changed = replace(box_vehicle, **{part: change(getattr(box_vehicle, part))})
    before, found = (TapCache(tmp_path, vehicle, settings).get(view(0)) for vehicle in (box_vehicle, changed))
    assert same(found, settings.build(changed, view(0), settings.pyramid(changed)))
    assert not same(found, before)


def test_memory_is_bounded_and_keeps_the_latest(box_vehicle: Vehicle, tmp_path: Path) -> None:
    sizes = [build_taps(box_vehicle, view(a), 64, 2).nbytes for a in range(3)]
    cache = TapCache(tmp_path, box_vehicle, SETTINGS, memory_bytes=sum(sizes) - 1)
    first, second = cache.get(view(0)), cache.get(view(1))
    assert cache.get(view(0)) is first
    cache.get(view(2))
    assert cache.get(view(0)) is first
    assert cache.get(view(1)) is not second  # it was the least recently used


def test_warming_builds_all_reports_and_stops(box_vehicle: Vehicle, tmp_path: Path) -> None:
    cache = TapCache(tmp_path, box_vehicle, SETTINGS)
    cameras, seen, stop = [view(a) for a in (0, 1, 0, 2, 3)], [], threading.Event()

    def on_view(done: int, total: int) -> None:
        seen.append((done, total))
        if done == 2:
            stop.set()

    worker = threading.Thread(target=cache.warm, args=(cameras, on_view, stop))
    worker.start()
    worker.join()
    assert seen == [(1, 4), (2, 4)]
    assert len(list(tmp_path.iterdir())) == 2
    files = {file: file.stat().st_mtime_ns for file in tmp_path.iterdir()}
    cache.warm(cameras)
    assert len(list(tmp_path.iterdir())) == 4
    assert all(file.stat().st_mtime_ns == written for file, written in files.items())
