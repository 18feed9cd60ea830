"""Weathers: presets valid and apart, CARLA's brought over, fog by height, which of them share one light."""

import itertools
import json
from dataclasses import replace

import pytest

from rauca_core.contract import RaucaError, Weather, find_preset, preset_notes, weather_from_carla
from rauca_core.contract.schema import Fields


def physics(weather):
    return tuple(value for key, value in weather.to_json().items() if key != "name")


def test_presets_are_what_they_are_called():
    for preset, suns in (("base", {-90, -30, 30, 90}), ("enhanced", {-90, 10, 45, 90})):
        weathers = find_preset(preset)
        pairs = {(w.sun_altitude_angle, w.fog_density) for w in weathers}
        assert pairs == {(sun, fog) for sun in suns for fog in (0, 25, 50, 90)}
    assert len(find_preset("single")) == 1
    with pytest.raises(RaucaError, match="'sunny' is unknown; choose one of base, carla, demo"):
        find_preset("sunny")


def test_no_unseen_weather_is_in_another_preset():
    unseen = find_preset("unseen")
    assert len(unseen) == 16
    assert sum(w.precipitation > 0 for w in unseen) >= 4
    assert any(w.film > 0 and w.precipitation == 0 for w in unseen)
    keys, names = {w.light_key() for w in unseen}, {w.name for w in unseen}
    assert len(keys) == 16
    for preset in ("base", "enhanced", "single", "demo"):
        for other in find_preset(preset):
            assert other.light_key() not in keys
            assert other.name not in names


def test_a_weather_survives_its_json_and_may_leave_out_what_has_a_default():
    weather = find_preset("unseen")[-1]
    assert Weather.from_json(Fields(weather.to_json(), "w")) == weather
    assert Weather.from_json(Fields({"name": "x", "sun_altitude_angle": 45}, "w")) == Weather("x", 45.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"name": "../x"}, "name '../x' may hold only letters"),
        ({"sun_altitude_angle": 91}, "sun_altitude_angle must be between -90 and 90"),
        ({"cloudiness": 101}, "cloudiness must be between 0 and 100"),
        ({"fog_falloff": -1}, "fog_falloff must be between"),
        ({"precipitation": "much"}, "precipitation must be a finite number"),
        ({"snow": 3}, "unknown field snow"),
        ({"name": "x" * 129}, r"name x{20}\.\.\. has 129 characters, at most 128"),
    ],
)
def test_bad_numbers_are_named(change, message):
    good = {"name": "x", "sun_altitude_angle": 45, "sun_azimuth_angle": 60, "fog_density": 0}
    with pytest.raises(RaucaError, match=f"w: {message}"):
        Weather.from_json(Fields(good | change, "w"))


def test_carlas_own_presets_are_brought_over():
    weathers = {w.name: w for w in find_preset("carla")}
    assert len(weathers) == 21
    hard = weathers["HardRainNight"]
    wet = (hard.precipitation, hard.precipitation_deposits, hard.wind_intensity, hard.fog_density)
    assert wet == (100, 90, 100, 100)
    assert (hard.sun_altitude_angle, hard.cloudiness, hard.wetness, hard.fog_falloff) == (-90, 100, 100, 0.1)
    assert weathers["ClearNoon"].sun_azimuth_angle == 1.0  # CARLA's -1, clockwise
    assert preset_notes("carla") == []


def test_what_carla_has_and_we_have_not_is_told(tmp_path):
    entry = {"name": "storm", "sun_altitude_angle": 45, "dust_storm": 100, "mie_scattering_scale": 0.03}
    path = tmp_path / "w.json"
    path.write_text(json.dumps({"format": "rauca-weathers", "version": 1, "convention": "carla", "weathers": [entry]}))
    (weather,) = find_preset(str(path))
    assert weather == Weather("storm", 45.0, 0.0, fog_falloff=0.2)
    (note,) = preset_notes(str(path))
    assert note.endswith("weathers[0]: dust_storm 100 has no counterpart here and is ignored")
    with pytest.raises(RaucaError, match=r"mine: unknown field cloud\b"):
        weather_from_carla({"cloud": 3}, "x", "mine")
    assert weather_from_carla({"sun_azimuth_angle": 90}, "x")[0].sun_azimuth_angle == 270.0


def test_fog_is_uniform_without_falloff():
    fog = Weather("fog", 45, fog_density=50, fog_falloff=1.0)
    assert fog.extinction == pytest.approx(0.015)
    assert replace(fog, fog_falloff=0.0).fog_is_uniform
    assert not fog.fog_is_uniform


def test_weathers_of_one_light():
    night = Weather("a", -90, 60, 50)
    assert night.light_key() == Weather("b", -30, 200, 50).light_key()  # the sun is far below, wherever it is
    assert night.light_key() != Weather("c", -10, 60, 50).light_key()  # twilight
    assert Weather("d", 90, 0).light_key() == Weather("e", 90, 180).light_key()
    assert Weather("d", 45, 0).light_key() != Weather("e", 45, 180).light_key()
    assert Weather("d", 45, 0).light_key() == Weather("e", 45, 0, fog_falloff=2, wind_intensity=30).light_key()
    assert Weather("d", 45, 0).light_key() != Weather("e", 45, 0, precipitation=5).light_key()  # the road gets wet


def test_lamps_come_on_smoothly():
    levels = [Weather("w", sun).lamps for sun in (10, 0, -1, -3, -5, -6, -90)]
    assert levels[0] == levels[1] == 0.0
    assert levels[-1] == levels[-2] == 1.0
    assert all(a <= b for a, b in itertools.pairwise(levels))
    assert levels[3] == pytest.approx(0.5)
