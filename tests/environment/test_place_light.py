from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from pipelines.cli import app
from rauca_core.attack.lights import light_source
from rauca_core.contract import RaucaError
from rauca_core.contract.files import png_bytes
from rauca_core.contract.irradiance import irradiance_folder, load_irradiance
from rauca_core.environment import load_exact
from rauca_core.environment.place_light import PlaceLight, light_places
from rauca_core.runtime.images import read_image


@pytest.fixture
def lit(dataset_factory, tmp_path, box_vehicle):
    return dataset_factory(tmp_path / "lit", box_vehicle, size=48, views=4, locations=1)


def test_the_light_of_every_place_is_stored_once_and_read_as_maps(lit):
    made = list(light_places(lit.folder))
    assert [(light.location, light.weather, fitted) for light, fitted in made] == [(0, "clear", True), (0, "fog", True)]
    assert all(len(light.sources) == 4 and light.held_out_db is not None and light.seen > 0.5 for light, _ in made)
    assert not any(fitted for _, fitted in light_places(lit.folder))

    places = PlaceLight(lit)
    for frame in lit.frames():
        exact, found = load_exact(lit, frame.id), places.light_of(frame)
        assert np.array_equal(found.B, exact.B)
        assert np.isfinite(found.A).all()
        paint = exact.A[..., 0] > 0
        inside = paint & np.roll(paint, 1, 0) & np.roll(paint, -1, 0) & np.roll(paint, 1, 1) & np.roll(paint, -1, 1)
        assert inside.sum() > 30
        # The frames were drawn without a finish, which the fit takes the paint to have: that much they differ.
        assert np.median(np.abs(found.A - exact.A)[inside] / exact.A[inside]) < 0.05


def test_something_before_the_paint_keeps_the_rendered_light(lit):
    frame = lit.frames()[0]
    path = lit.frame_folder(frame.id) / "paint.png"
    pole = read_image(path).copy()
    assert pole[:, 24:27].any()
    pole[:, 24:27] = 0
    path.write_bytes(png_bytes(pole))
    list(light_places(lit.folder))
    exact, found = load_exact(lit, frame.id), PlaceLight(lit).light_of(frame)
    assert np.array_equal(found.A[:, 24:27], exact.A[:, 24:27])


def test_a_frame_more_is_a_new_fit(lit):
    list(light_places(lit.folder))
    frame = lit.frames()[0]
    for file in lit.frame_folder(frame.id).iterdir():
        file.unlink()
    lit.frame_folder(frame.id).rmdir()
    assert [fitted for _, fitted in light_places(lit.folder)] == [True, False]


def test_what_is_missing_damaged_or_another_vehicles_is_named(lit):
    places, folder = PlaceLight(lit), irradiance_folder(lit.folder, 0, "fog")
    with pytest.raises(RaucaError, match=r"not fitted yet; run `rauca dataset light"):
        light_source("irradiance", lit, places.vehicle, None, "cpu")
    list(light_places(lit.folder))
    light_source("irradiance", lit, places.vehicle, None, "cpu")

    told = json.loads((folder / "irradiance.json").read_text())
    (folder / "irradiance.json").write_text(json.dumps(told | {"finish": "sticker"}))
    with pytest.raises(RaucaError, match=r"irradiance\.json: missing, or not what was written; remove .*fog"):
        load_irradiance(folder)
    assert [fitted for _, fitted in light_places(lit.folder)] == [False, True]
    (folder / "texels.npz").write_bytes(b"")
    with pytest.raises(RaucaError, match=r"texels\.npz: missing, or not what was written"):
        places.read(0, "fog")


def test_the_command_tells_residuals(lit):
    result = CliRunner().invoke(app, ["dataset", "light", str(lit.folder)])
    assert result.exit_code == 0
    assert "L00" in result.output
    assert "fog" in result.output


def test_frames_without_light_are_refused(dataset_factory, tmp_path, box_vehicle):
    dark = dataset_factory(tmp_path / "dark", box_vehicle, light=False)
    with pytest.raises(RaucaError, match="without light maps"):
        list(light_places(dark.folder))
