"""Composed frames against a room whose every view is known exactly, in the hard cases too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.stability.drawn import painted_box
from rauca_core.contract import Camera, Dataset, RaucaError, Ring, Vehicle, Weather, load_frame
from rauca_core.contract.color import linear_to_srgb, srgb_to_linear
from rauca_core.contract.semantics import CLASS_IDS, mask_box
from rauca_core.dataset_tools import check_dataset
from rauca_core.environment.views import Composed, Place, View, Views, compose, densify, drawn
from rauca_core.environment.views.sources import mixed
from rauca_core.study.datasets import Dataset as OpenDataset
from rauca_core.study.evaluate import open_views
from tests.environment.room import POSE, REFERENCE, SIZE, look, make_room

BETWEEN = 45.0  # degrees: half way between two sources
POLE = (((2.5, -4.2, 0.0), (2.9, -3.8, 4.0)),)


def view_from(azimuth_deg: float, elevation_deg: float = 18.0, metres: float = 7.0, aside: float = 0.0) -> View:
    """A camera around the vehicle that looks ``aside`` of it, metres."""
    around, up = np.radians([azimuth_deg, elevation_deg])
    eye = np.array([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)]) * metres + [0, 0, 0.75]
    aim = np.array([0, aside, 0.75])
    world = np.stack([eye, aim]) @ POSE[:3, :3].T + POSE[:3, 3]
    camera = Camera.look_at(world[0], world[1], 60.0, SIZE, SIZE)
    return View("new", 0, 0, camera, azimuth_deg, elevation_deg, metres, 1)


def composed(dataset: Dataset, view: View, vehicle: Vehicle, count: int | None = None) -> Composed:
    place = Place.of(dataset, dataset.frames()[:count])
    return compose(place, view, vehicle, srgb_to_linear(np.array(REFERENCE) / 255))


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(-10 * np.log10(np.mean((linear_to_srgb(one) - linear_to_srgb(other)) ** 2)))


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return painted_box()


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory, vehicle: Vehicle) -> Dataset:
    return make_room(tmp_path_factory.mktemp("views") / "room", vehicle)


def test_a_camera_between_the_sources_sees_what_it_would_have_seen(room: Dataset, vehicle: Vehicle):
    view = view_from(BETWEEN)
    made, truth = composed(room, view, vehicle), look(view.camera)
    stops = np.float32(2.0**made.frame.exposure_stops)
    around = (truth.vehicle == 0) & (made.passes.vehicle == 0) & made.known
    assert around.mean() > 0.6
    assert psnr(made.passes.B[around] / stops, truth.B[around]) > 33
    paint = (made.passes.paint > 0.99) & (truth.paint == 1) & made.known
    assert psnr(made.passes.A[paint] / stops, truth.A[paint]) > 30
    near = np.isfinite(truth.distance) & np.isfinite(made.passes.distance)
    off = np.abs(made.passes.distance[near] - truth.distance[near]) / truth.distance[near]
    assert np.quantile(off, 0.9) < 0.02
    assert (made.passes.semantic == truth.semantic).mean() > 0.95


@pytest.mark.parametrize("aside", [0.0, 3.0, -4.0])
def test_boxes_and_coverage_are_those_of_the_mesh_also_where_the_frame_cuts_it(
    room: Dataset, vehicle: Vehicle, aside: float
):
    view = view_from(100.0, aside=aside, metres=5.5)
    made, truth = composed(room, view, vehicle), look(view.camera)
    assert np.abs(np.subtract(made.frame.box_xyxy, mask_box(truth.vehicle > 0.5))).max() <= 1
    assert np.abs(made.passes.vehicle - truth.vehicle).mean() < 0.02
    assert made.frame.visible == 1.0


def test_one_source_fills_what_it_never_saw_and_says_so(room: Dataset, vehicle: Vehicle):
    made = composed(room, view_from(60.0), vehicle, count=1)
    assert made.known.mean() < 0.8
    assert made.frame.composed == (room.frames()[0].id,)
    for light in (made.passes.A, made.passes.B, made.passes.image_linear):
        assert np.isfinite(light).all()
        assert light.min() >= 0
    unseen = ~made.known & (made.passes.vehicle == 0)
    lost = made.passes.semantic[unseen]
    assert set(np.unique(lost)) == {CLASS_IDS["unlabeled"]}
    assert made.passes.B[unseen].mean() > 0.05  # the nearest colors, not black


def test_a_camera_below_and_behind_every_source_is_filled(room: Dataset, vehicle: Vehicle):
    made = composed(room, view_from(200.0, elevation_deg=2.0, metres=4.0), vehicle, count=2)
    assert np.isfinite(made.passes.B).all()
    assert np.isfinite(made.passes.A).all()
    assert made.frame.box_xyxy is not None


def test_a_pole_before_the_vehicle_stays_and_hides_it(tmp_path: Path, vehicle: Vehicle):
    dataset = make_room(tmp_path / "poles", vehicle, poles=POLE)
    to_pole = np.linalg.inv(POSE) @ np.array([2.7, -4.0, 0.0, 1.0])
    view = view_from(float(np.degrees(np.arctan2(to_pole[1], to_pole[0]))) + 8.0)
    made, truth = composed(dataset, view, vehicle), look(view.camera, POLE)
    pole = truth.semantic == CLASS_IDS["pole"]
    before = pole & (composed(make_room(tmp_path / "bare", vehicle), view, vehicle).passes.vehicle > 0.99)
    assert before.sum() > 20
    assert (made.passes.semantic[pole] == CLASS_IDS["pole"]).mean() > 0.8
    assert (made.passes.vehicle[before] == 0).mean() > 0.8
    red = made.passes.B[before]
    assert (red[:, 0] > 5 * red[:, 1]).mean() > 0.8
    assert made.frame.visible < 0.99


def test_rain_and_exposure_are_taken_out_of_the_sources_and_put_on_anew(tmp_path: Path, vehicle: Vehicle):
    wet = Weather("rain", 45.0, precipitation=50.0)
    dataset = make_room(tmp_path / "wet", vehicle, (0.0, 90.0), (wet,), stops=1.5)
    frames = dataset.frames()
    place = Place.of(dataset, frames)
    truth = look(frames[0].camera)
    assert psnr(place.around.values[0], truth.B) > 45
    made = composed(dataset, view_from(10.0), vehicle)
    dry = composed(make_room(tmp_path / "dry", vehicle, (0.0, 90.0)), view_from(10.0), vehicle)
    assert made.passes.B[dry.passes.vehicle == 0].mean() != pytest.approx(dry.passes.B[dry.passes.vehicle == 0].mean())


def test_a_silhouette_is_mixed_and_a_slope_is_not():
    slope = (1.0 / np.linspace(0.5, 0.05, 40))[:, None] * np.ones((1, 40))
    assert not mixed(slope.astype(np.float32)).any()
    edge = np.full((9, 9), 10.0, np.float32)
    edge[:, :4], edge[:, 4] = 3.0, 6.0
    assert mixed(edge)[1:-1, 4].all()
    assert mixed(edge).sum() == 9
    pole = np.full((9, 9), 10.0, np.float32)
    pole[:, 4] = 3.0
    assert not mixed(pole).any()


def test_views_are_functions_of_the_seed_and_lie_between_the_sources(room: Dataset):
    one, same, other = (OpenDataset(room.folder).views(5, seed=seed) for seed in (1, 1, 2))
    last, first = one[4], one[0]
    for again in (same[0], one[0]):  # whatever was composed before
        np.testing.assert_array_equal(again.passes.image_linear, first.passes.image_linear)
        assert again.frame.to_json() == first.frame.to_json()
    assert not np.allclose(other[0].frame.camera.t, first.frame.camera.t)
    assert last.frame.id != first.frame.id
    for made in one:
        assert 12.0 <= made.frame.elevation_deg <= 24.0
        assert made.frame.distance_m == 7.0
        assert len(made.frame.composed) == 6


def test_few_sources_are_told(room: Dataset, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture):
    monkeypatch.setattr(drawn, "ENOUGH_SOURCES", len(room.frames()) + 1)
    Views(room, 2)
    assert f"1 of 1 places and weathers have fewer than {len(room.frames()) + 1} rendered views" in caplog.text
    caplog.clear()
    monkeypatch.setattr(drawn, "ENOUGH_SOURCES", len(room.frames()))
    Views(room, 2)
    assert not caplog.text


def test_densify_writes_a_whole_data_set_that_nobody_is_judged_on(tmp_path: Path, room: Dataset):
    out = tmp_path / "dense"
    made = densify(Views(room, 6, seed=3), out)
    assert len(made.frames()) == 6
    assert check_dataset(out).findings == []
    bytes_before = {path: path.read_bytes() for path in sorted(out.rglob("*.png"))}
    lost = made.frame_folder(made.frames()[2].id)
    for path in lost.iterdir():
        path.unlink()
    lost.rmdir()
    densify(Views(room, 6, seed=3), out)  # goes on, and comes to the same
    assert {path: path.read_bytes() for path in sorted(out.rglob("*.png"))} == bytes_before
    with pytest.raises(RaucaError, match="another seed"):
        densify(Views(room, 6, seed=4), out)
    with pytest.raises(RaucaError, match=r"was composed from other frames.*rauca dataset make"):
        open_views([out])
    with pytest.raises(RaucaError, match="new views are composed from rendered ones"):
        Views(made, 2)


def test_a_rendered_frame_says_nothing_of_composing(room: Dataset):
    frame = room.frames()[0]
    assert "composed" not in frame.to_json()
    assert load_frame(room.frame_folder(frame.id)).composed == ()


def test_mistakes_are_told(tmp_path: Path, room: Dataset):
    with pytest.raises(RaucaError, match="1 or more"):
        Views(room, 0)
    with pytest.raises(RaucaError, match="need a ring of 9 cameras, this one has 2; give it more azimuths"):
        Views(room, 9, Ring((0.0, 90.0), (10.0,), (7.0,)))
    with pytest.raises(RaucaError, match="choose another folder"):
        densify(Views(room, 1), room.folder)
