import numpy as np
import pytest

from rauca_core.contract import Camera, RaucaError
from rauca_core.contract.schema import Fields


def a_camera() -> Camera:
    return Camera.look_at(np.array([6.0, -3.0, 2.0]), np.array([0.0, 0.0, 0.7]), 60.0, 320, 240, roll_deg=7.0)


def test_the_target_is_in_the_middle_and_up_is_up():
    camera = Camera.look_at(np.array([6.0, -3.0, 2.0]), np.array([0.0, 0.0, 0.7]), 60.0, 320, 240)
    pixels, depth = camera.project(np.array([[0.0, 0.0, 0.7], [0.0, 0.0, 1.7]]))
    assert np.allclose(pixels[0], [160, 120])
    assert depth[0] == pytest.approx(np.linalg.norm([6, -3, 1.3]))
    assert pixels[1, 1] < 120
    assert pixels[1, 0] == pytest.approx(160)


def test_opencv_convention():
    camera = Camera.look_at(np.array([5.0, 0.0, 0.0]), np.zeros(3), 90.0, 100, 100)
    pixels, depth = camera.project(np.array([[0.0, 5.0, 0.0], [0.0, 0.0, -5.0], [9.0, 0.0, 0.0]]))
    assert np.allclose(pixels[0], [100, 50])  # world +y is to the right of someone looking along -x
    assert np.allclose(pixels[1], [50, 100])  # down is +y in the image
    assert depth[2] < 0
    assert np.linalg.det(camera.R) == pytest.approx(1)
    assert np.allclose(camera.position, [5, 0, 0])


def test_straight_down_is_a_camera_too():
    camera = Camera.look_at(np.array([0.0, 0.0, 9.0]), np.zeros(3), 60.0, 64, 64)
    assert np.allclose(camera.R @ camera.R.T, np.eye(3))


def test_relative_to_sees_the_same_pixels():
    camera = a_camera()
    pose = np.eye(4)
    pose[:2, :2] = [[0.6, -0.8], [0.8, 0.6]]
    pose[:3, 3] = [3.0, -1.0, 0.2]
    local = np.random.default_rng(0).normal(size=(10, 3))
    world = local @ pose[:3, :3].T + pose[:3, 3]
    assert np.allclose(camera.project(world)[0], camera.relative_to(pose).project(local)[0])


def test_json_round_trip_and_refusals():
    camera = a_camera()
    again = Camera.from_json(Fields(camera.to_json(), "f"))
    assert np.array_equal(again.K, camera.K)
    assert np.array_equal(again.R, camera.R)
    for field, value, message in [
        ("R", np.diag([1.0, 1.0, -1.0]).tolist(), "R is not a rotation"),
        ("K", np.zeros((3, 3)).tolist(), "pinhole"),
        ("width", 0, "width"),
        ("t", [0, 0], "t must be 3 finite numbers"),
    ]:
        with pytest.raises(RaucaError, match=message):
            Camera.from_json(Fields({**camera.to_json(), field: value}, "frame.json: camera"))


def test_eye_on_target_is_refused():
    with pytest.raises(RaucaError, match="coincide"):
        Camera.look_at(np.zeros(3), np.zeros(3), 60, 8, 8)
