"""Pictures become frames: the camera is found from noisy marks and the silhouette, and they are judged on apart."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.stability.drawn import painted_box
from pipelines.cli import app
from rauca_core.contract import Camera, Dataset, RaucaError, Vehicle, load_passes, load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.contract.color import linear_to_srgb
from rauca_core.contract.files import png_bytes
from rauca_core.dataset_tools import load_vehicle as load_vehicle_of
from rauca_core.dataset_tools.check import check_dataset
from rauca_core.environment.views.body import see_body
from rauca_core.pictures.add import add_picture
from rauca_core.pictures.fit import coverage, iou, moved, refine, reprojection_px, solve_camera
from rauca_core.pictures.points import MarkedPoint, MarkedPoints
from rauca_core.runtime.images import read_image
from rauca_core.study.evaluate import RandomPaint, evaluate, open_views
from rauca_core.study.study import load_study
from tests.environment.room import make_room

SIZE = 256


@pytest.fixture(scope="module")
def sedan() -> Vehicle:
    return load_vehicle(assets_folder() / "vehicles" / "sedan", read_image)


@pytest.fixture(scope="module")
def truth() -> Camera:
    return Camera.look_at(np.array([5.0, 4.0, 2.5]), np.array([0.0, 0, 0.7]), 60.0, SIZE, SIZE)


def marks(vehicle: Vehicle, camera: Camera, noise_px: float) -> MarkedPoints:
    rng = np.random.default_rng(3)
    chosen = vehicle.positions[rng.choice(len(vehicle.positions), 8, replace=False)].astype(float)
    pixels = camera.project(chosen)[0] + rng.normal(size=(8, 2)) * noise_px
    return MarkedPoints(tuple(MarkedPoint(f"p{i}", *pair) for i, pair in enumerate(zip(chosen, pixels, strict=True))))


def test_exact_marks_give_the_camera_and_its_focal_length(sedan: Vehicle, truth: Camera) -> None:
    points = marks(sedan, truth, 0.0)
    found = solve_camera(points, SIZE, SIZE)
    assert reprojection_px(found, points) < 0.01
    assert found.fov_deg == pytest.approx(truth.fov_deg, abs=0.1)
    assert np.allclose(found.position, truth.position, atol=0.02)


def test_the_silhouette_mends_what_noisy_marks_leave(sedan: Vehicle, truth: Camera) -> None:
    wanted = coverage(sedan, truth)
    start = moved(truth, np.array([0.04, 0.02, -0.02, 0.02, 0.01, 0.01, 0.03]))
    found = refine(sedan, start, wanted, marks(sedan, truth, 1.0))
    assert iou(coverage(sedan, start), wanted) < 0.95
    assert iou(coverage(sedan, found), wanted) > 0.985


def test_points_of_one_plane_are_refused() -> None:
    flat = tuple(MarkedPoint(str(i), np.array([i, i**2, 0.0]), np.zeros(2)) for i in range(6))
    with pytest.raises(RaucaError, match="one plane"):
        MarkedPoints(flat).check("points.json")


def test_the_command_writes_frames_that_are_evaluated_apart(sedan: Vehicle, truth: Camera, tmp_path: Path) -> None:
    seen = coverage(sedan, truth)
    (tmp_path / "car.png").write_bytes(png_bytes(np.repeat((60 + 100 * seen)[..., None], 3, 2).astype(np.uint8)))
    out = tmp_path / "set"
    nearer = moved(truth, np.array([0, 0, 0.2, 0, 0, 0, -0.2]))
    for number, camera in enumerate((truth, nearer), 1):
        (tmp_path / "camera.json").write_text(json.dumps(camera.to_json()))
        told = [str(tmp_path / "car.png"), "--vehicle", "sedan", "--camera", str(tmp_path / "camera.json")]
        done = CliRunner().invoke(app, ["picture", "add", *told, "--out", str(out)], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        frames = Dataset(out).frames()
        assert len(frames) == number
    assert frames[-1].composed == ("picture car.png",)
    assert frames[-1].visible == pytest.approx(1, abs=0.1)
    assert (out / "fits" / f"{frames[-1].id}.png").is_file()
    assert not check_dataset(out).findings
    with pytest.raises(RaucaError, match="is a picture whose light is estimated"):
        open_views([out])
    rendered = make_room(tmp_path / "room", painted_box(), (0.0,)).folder
    with pytest.raises(RaucaError, match="pictures and rendered views in one study"):
        open_views([rendered, out], pictures=True)
    _evaluate(out, tmp_path / "study")


def _evaluate(pictures: Path, out: Path) -> None:
    """Random paint is composed on the pictures, by their own light maps, and every result says so."""
    study = evaluate([], ["frcnn-synth"], datasets=[pictures], random=RandomPaint(size=64), out=out)
    (entry,) = load_study(out).entries
    assert entry.weathers == study.entries[0].weathers == f"{pictures.name}, composed"
    assert entry.results.composed
    assert set(entry.results.table) == {"normal", "random"}
    views = Dataset(pictures)
    for frame, image in zip(views.frames(), entry.results.images["random"], strict=True):
        shown = read_image(entry.folder / image.path).astype(int)
        plain, paint = (read_image(views.frame_folder(frame.id) / name) for name in ("image.png", "paint.png"))
        assert (shown[paint == 0] == plain[paint == 0]).all()
        assert np.abs(shown - plain)[paint == 255].mean() > 10
        lit = load_passes(views.frame_folder(frame.id), ("A", "B"))
        darkest, lightest = (linear_to_srgb(lit["A"].astype(np.float32) * x + lit["B"]) * 255 for x in (0.0, 1.0))
        inside = (shown >= darkest - 2) & (shown <= lightest + 2)
        assert inside[paint == 255].mean() > 0.99


def test_a_picture_that_is_not_square_lies_between_bars(sedan: Vehicle, tmp_path: Path) -> None:
    camera = Camera.look_at(np.array([5.0, 4.0, 2.5]), np.array([0.0, 0, 0.7]), 60.0, 256, 160)
    seen, body = coverage(sedan, camera), see_body(sedan, camera)
    picture = 90 + (np.array([200, 20, 30]) - 90) * body.paint[..., None]
    (tmp_path / "car.png").write_bytes(png_bytes(picture.astype(np.uint8)))
    (tmp_path / "camera.json").write_text(json.dumps(camera.to_json()))
    added = add_picture(tmp_path / "car.png", sedan, tmp_path / "set", camera=tmp_path / "camera.json")
    red, green, blue = added.paint_srgb  # told by the picture
    assert red > 2 * max(green, blue)
    frame, folder = added.frame, Dataset(tmp_path / "set").frame_folder(added.frame.id)
    image = read_image(folder / "image.png")
    assert image.shape == (256, 256, 3)
    assert (image[:48] == 114).all()
    assert (image[-48:] == 114).all()
    again = coverage(sedan, frame.camera_in_vehicle)
    assert iou(again[48:-48], seen) > 0.99
    assert not check_dataset(tmp_path / "set").findings


def test_a_vehicle_is_read_from_a_mesh_file(tmp_path: Path) -> None:
    box = painted_box()
    corners, uvs = box.positions, box.uvs.reshape(-1, 2)
    lines = [*(f"v {x} {y} {z}" for x, y, z in corners), *(f"vt {u} {v}" for u, v in uvs), "usemtl paint"]
    for face, (a, b, c) in enumerate(box.triangles):
        lines.append("f " + " ".join(f"{v + 1}/{3 * face + k + 1}" for k, v in enumerate((a, b, c))))
    (tmp_path / "box.obj").write_text("\n".join(lines) + "\n")
    found = load_vehicle_of(tmp_path / "box.obj", paint_material="paint")
    assert len(found.triangles) == len(box.triangles)
    with pytest.raises(RaucaError, match=r"--paint-material are of an \.obj"):
        load_vehicle_of("sedan", paint_material="paint")


def test_the_command_solves_the_camera_from_marks_and_mask(sedan: Vehicle, truth: Camera, tmp_path: Path) -> None:
    seen = coverage(sedan, truth)
    marked = {"format": "rauca-points", "version": 1} | marks(sedan, truth, 1.0).to_json()
    (tmp_path / "points.json").write_text(json.dumps(marked))
    (tmp_path / "mask.png").write_bytes(png_bytes((255 * seen).astype(np.uint8)))
    (tmp_path / "car.png").write_bytes(png_bytes(np.repeat((60 + 100 * seen)[..., None], 3, 2).astype(np.uint8)))
    files = [str(tmp_path / name) for name in ("car.png", "points.json", "mask.png")]
    told = [files[0], "--vehicle", "sedan", "--points", files[1], "--mask", files[2], "--out", str(tmp_path / "set")]
    done = CliRunner().invoke(app, ["picture", "add", *told], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    (frame,) = Dataset(tmp_path / "set").frames()
    assert iou(coverage(sedan, frame.camera_in_vehicle), seen) > 0.985
    assert not check_dataset(tmp_path / "set").findings


def test_a_camera_in_another_frame_is_told(sedan: Vehicle, truth: Camera, tmp_path: Path) -> None:
    """Of a frame whose origin is the body's middle and not the ground: the vehicle is drawn too high."""
    seen = coverage(sedan, truth)
    (tmp_path / "mask.png").write_bytes(png_bytes((255 * seen).astype(np.uint8)))
    (tmp_path / "car.png").write_bytes(png_bytes(np.repeat((60 + 100 * seen)[..., None], 3, 2).astype(np.uint8)))
    lifted = Camera(truth.K, truth.R, truth.t + truth.R @ np.array([0, 0, 0.8]), SIZE, SIZE)
    told = []
    for camera, more in ((truth, ["--mask", "mask.png"]), (lifted, ["--mask", "mask.png"]), (lifted, [])):
        (tmp_path / "camera.json").write_text(json.dumps(camera.to_json()))
        files = [str(tmp_path / word) if word.endswith("png") else word for word in ("car.png", *more)]
        given = ["picture", "add", *files, "--vehicle", "sedan", "--camera", str(tmp_path / "camera.json")]
        done = CliRunner().invoke(app, [*given, "--out", str(tmp_path / "set")], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        told.append(done.output)
    assert "warning" not in told[0]
    assert "warning: vehicle and mask overlap little" in told[1]
    assert "nothing checked it" in told[2]
