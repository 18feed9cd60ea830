"""Drawn views in the light of irradiance textures: hard cases, what hides the paint, data sets that carry it."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from benchmarks.stability.drawn import painted_box
from rauca_core.attack.lights import light_source
from rauca_core.contract import Dataset, RaucaError, Vehicle, load_vehicle
from rauca_core.contract.color import srgb_to_linear
from rauca_core.contract.semantics import CLASS_IDS, mask_box
from rauca_core.environment import load_exact
from rauca_core.environment.place_light import PlaceLight, light_places
from rauca_core.environment.views import Composed, Place, View, Views, compose, densify
from rauca_core.environment.views.drawn import PaintLight
from rauca_core.runtime.images import read_image
from tests.environment.room import POSE, REFERENCE, look, make_room
from tests.environment.test_views import BETWEEN, POLE, psnr, view_from


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return painted_box()


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory, vehicle: Vehicle) -> Dataset:
    made = make_room(tmp_path_factory.mktemp("lit") / "room", vehicle)
    list(light_places(made.folder))
    return made


def lit(dataset: Dataset, view: View, vehicle: Vehicle, sources: slice = slice(None)) -> Composed:
    """A view in the light that is fitted to some of the frames."""
    frames = dataset.frames()[sources]
    irradiance, light = PlaceLight(dataset).fit(frames)[1], PaintLight(dataset)
    gain = light.gain(irradiance, view.camera.relative_to(POSE))
    return compose(Place.of(dataset, frames), view, vehicle, srgb_to_linear(np.array(REFERENCE) / 255), gain=gain)


def test_between_the_sources_the_paint_is_lit_as_it_would_be(room: Dataset, vehicle: Vehicle) -> None:
    view = view_from(BETWEEN)
    made, truth = lit(room, view, vehicle), look(view.camera)
    paint = (made.passes.paint > 0.99) & (truth.paint == 1)
    assert psnr(made.passes.A[paint] / np.float32(2.0**made.frame.exposure_stops), truth.A[paint]) > 30


@pytest.mark.parametrize(
    ("sources", "view"),
    [
        (slice(0, 1), view_from(20.0)),
        (slice(0, 1), view_from(185.0)),
        (slice(0, 24, 6), view_from(BETWEEN, elevation_deg=2.0, metres=4.0)),
        (slice(0, 24, 3), view_from(100.0, aside=3.0, metres=5.5)),
        (slice(0, 24, 3), view_from(100.0, aside=-4.0, metres=5.5)),
    ],
    ids=["one source", "one source, of the other side", "below every source", "cut at the left", "cut at the right"],
)
def test_hard_views_are_finite_and_their_box_is_right(
    room: Dataset, vehicle: Vehicle, sources: slice, view: View
) -> None:
    made, truth = lit(room, view, vehicle, sources), look(view.camera)
    assert made.passes.A is not None
    for light in (made.passes.A, made.passes.B, made.passes.image_linear):
        assert np.isfinite(light).all()
        assert light.min() >= 0
    assert np.abs(np.subtract(made.frame.box_xyxy, mask_box(truth.vehicle > 0.5))).max() <= 1
    assert not made.passes.A[made.passes.paint == 0].any()
    assert made.passes.A[made.passes.paint > 0.99].min() > 0.05  # filled, not black, where no source saw the paint


def test_nothing_shines_through_a_pole(tmp_path: Path, vehicle: Vehicle) -> None:
    dataset = make_room(tmp_path / "poles", vehicle, poles=POLE)
    to_pole = np.linalg.inv(POSE) @ np.array([2.7, -4.0, 0.0, 1.0])
    view = view_from(float(np.degrees(np.arctan2(to_pole[1], to_pole[0]))) + 8.0)
    made, truth = lit(dataset, view, vehicle), look(view.camera, POLE)
    before = (truth.semantic == CLASS_IDS["pole"]) & (look(view.camera).paint == 1)
    assert before.sum() > 20
    assert (made.passes.A[before] == 0).all(axis=-1).mean() > 0.8
    beside = (made.passes.paint > 0.99) & (truth.paint == 1)
    stops = np.float32(2.0**made.frame.exposure_stops)
    assert psnr(made.passes.A[beside] / stops, truth.A[beside]) > 27


def test_views_of_a_data_set_are_lit_by_its_textures_where_it_has_them(tmp_path: Path, room: Dataset) -> None:
    plain = tmp_path / "plain"
    shutil.copytree(room.folder, plain, ignore=shutil.ignore_patterns("irradiance"))
    ours, warped = Views(room, 2, seed=1)[1], Views(Dataset(plain), 2, seed=1)[1]
    solid = ours.passes.paint > 0.99
    np.testing.assert_array_equal(ours.passes.paint, warped.passes.paint)
    assert ours.passes.A is not None
    assert warped.passes.A is not None
    ratio = (
        ours.passes.A[solid] / warped.passes.A[solid] * 2.0 ** (warped.frame.exposure_stops - ours.frame.exposure_stops)
    )
    assert 0 < np.abs(ratio - 1).mean() < 0.1

    light = PaintLight(Dataset(plain))
    assert light.read(0, "day") is None  # of a place whose light was not fitted the gain is warped
    shutil.copytree(room.folder / "irradiance", plain / "irradiance")
    (plain / "irradiance" / "L00-day" / "texels.npz").write_bytes(b"")
    with pytest.raises(RaucaError, match=r"texels\.npz: missing, or not what was written"):
        Views(Dataset(plain), 2, seed=1)[1]


def test_densify_carries_the_light(tmp_path: Path, room: Dataset) -> None:
    out = tmp_path / "dense"
    made = densify(Views(room, 3, seed=3), out)
    name = "irradiance/L00-day"
    for file in ("texels.npz", "irradiance.json", "SHA256SUMS"):
        assert (out / name / file).read_bytes() == (room.folder / name / file).read_bytes()
    source = light_source("irradiance", made, load_vehicle(made.vehicle_folder, read_image), None, "cpu")
    for frame in made.frames():
        again, drawn = source.of(frame)[0], load_exact(made, frame.id)
        solid = read_image(made.frame_folder(frame.id) / "paint.png") > 252
        assert solid.sum() > 100
        assert np.median(np.abs(again.A - drawn.A)[solid] / drawn.A[solid]) < 0.02
    with pytest.raises(RaucaError, match=r"was composed .*light is fitted to .*rendered ones alone"):
        list(light_places(out))


def test_views_in_other_light_are_not_gone_on_with(tmp_path: Path, room: Dataset) -> None:
    sources = tmp_path / "sources"
    shutil.copytree(room.folder, sources, ignore=shutil.ignore_patterns("irradiance"))
    out = tmp_path / "dense"
    densify(Views(Dataset(sources), 2, seed=3), out)
    shutil.copytree(room.folder / "irradiance", sources / "irradiance")
    with pytest.raises(RaucaError, match=r"holds views in other light than that of .*choose another folder"):
        densify(Views(Dataset(sources), 2, seed=3), out)


def test_texels_that_no_source_saw_are_counted(tmp_path: Path, vehicle: Vehicle) -> None:
    dataset = make_room(tmp_path / "room", vehicle, azimuths=(0.0,))
    (light, fitted), *_ = light_places(dataset.folder)
    texels = len(PlaceLight(dataset).surface.light.texels)
    assert fitted
    assert light.unseen == pytest.approx((1 - light.seen) * texels, abs=0.5)
    assert light.unseen > texels / 2
