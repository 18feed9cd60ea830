"""Composed frames against renders of the same cameras: rows, pictures, and that light from a texture is told apart."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.in_blender import weathers_of
from benchmarks.stability.drawn import painted_box
from benchmarks.views import FULL, QUICK, bench
from rauca_core.contract import Dataset, RaucaError
from rauca_core.environment.place_light import light_places
from tests.environment.room import make_room

BETWEEN = (20.0, 110.0, 200.0)


@pytest.fixture(scope="module")
def rooms(tmp_path_factory: pytest.TempPathFactory) -> tuple[Dataset, Dataset]:
    folder = tmp_path_factory.mktemp("views")
    return make_room(folder / "sources", painted_box()), make_room(folder / "truth", painted_box(), azimuths=BETWEEN)


def test_rows_tables_and_pictures(rooms: tuple[Dataset, Dataset], tmp_path: Path) -> None:
    sources, truth = rooms
    out = tmp_path / "views.json"
    bench(out, QUICK, sources=sources.folder, truth=truth.folder)
    warped = json.loads(out.read_text())
    assert {round(row["azimuth_deg"]) for row in warped["frames"]} == {round(azimuth) for azimuth in BETWEEN}
    for row in warped["frames"]:
        assert row["light"] == "warped"
        assert row["gain_ms"] == 0.0
        assert row["frame_db"] > 25
    for row in warped["weathers"]:
        assert row["frames_per_s"] > 0
        assert row["cycles_clock"] == "wall"
    for name in ("views.jpg", "views-around.jpg"):
        assert (tmp_path / name).stat().st_size > 1000

    list(light_places(sources.folder))
    bench(out, QUICK, sources=sources.folder, truth=truth.folder)
    textured = json.loads(out.read_text())
    assert all(row["light"] == "texture" and row["gain_ms"] > 0 for row in textured["frames"])
    pairs = list(zip(textured["frames"], warped["frames"], strict=True))
    assert all(new["paint_db"] != old["paint_db"] for new, old in pairs)


def test_one_set_alone_is_refused(rooms: tuple[Dataset, Dataset], tmp_path: Path) -> None:
    with pytest.raises(RaucaError, match="give both or neither"):
        bench(tmp_path / "out.json", QUICK, sources=rooms[0].folder)


def test_every_weather_that_is_rendered_exists() -> None:
    for settings in (FULL, QUICK):
        assert [weather.name for weather in weathers_of(settings.weathers)] == list(settings.weathers)
