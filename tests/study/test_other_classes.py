"""Agreement of two detectors on everything but the vehicle: what counts, and pictures without it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stability.drawn import make_dataset
from rauca_core.contract import Vehicle
from rauca_core.detect.agreement import Agreement, agreement_of
from rauca_core.detect.found import Found
from rauca_core.runtime.images import read_image
from rauca_core.study.vacant import without_vehicle

HERE, THERE, ALMOST_HERE = (0.0, 0.0, 20.0, 10.0), (50.0, 50.0, 80.0, 80.0), (0.0, 1.0, 20.0, 11.0)


def found(*objects: tuple[tuple[float, ...], float, str]) -> Found:
    boxes = np.array([box for box, _, _ in objects], np.float64).reshape(-1, 4)
    return Found(boxes, np.array([score for _, score, _ in objects]), tuple(name for _, _, name in objects))


def test_an_object_agrees_by_class_place_and_half_the_score() -> None:
    one = found((HERE, 0.9, "dog"))
    for other, agreed, objects, kept in (
        (found((ALMOST_HERE, 0.3, "dog")), 1, 1, 1),  # the other one is not sure of it, but finds it
        (found((ALMOST_HERE, 0.6, "dog")), 2, 2, 1),
        (found((HERE, 0.6, "cat")), 0, 2, 0),
        (found((THERE, 0.6, "dog")), 0, 2, 0),
        (found((HERE, 0.2, "dog")), 0, 1, 0),
        (found(), 0, 1, 0),
    ):
        assert agreement_of([(one, other, None)]) == Agreement(agreed, objects, kept, 1)
        assert agreement_of([(other, one, None)]) == Agreement(agreed, objects, agreed - kept, objects - 1)
    nothing = agreement_of([(found(), found((HERE, 0.4, "dog")), None)])
    assert nothing.share is None
    assert nothing.kept_share is None


def test_the_vehicle_and_its_parts_are_left_out_and_what_stands_behind_it_counts() -> None:
    vehicle = np.array([45.0, 45.0, 85.0, 85.0])
    one, other = found((THERE, 0.9, "car"), ((0.0, 40.0, 90.0, 90.0), 0.9, "boat")), found()
    assert agreement_of([(one, other, vehicle)]) == Agreement(0, 1, 0, 1)
    assert agreement_of([(one, other, vehicle), (one, one, vehicle)]) == Agreement(2, 3, 1, 2)


def test_a_picture_without_its_vehicle_keeps_what_stands_beside_it(tmp_path, box_vehicle: Vehicle) -> None:
    dataset = make_dataset(tmp_path / "data", box_vehicle, 64, (40.0,))
    (frame, _) = dataset.frames()
    pixels = read_image(dataset.frame_folder(frame.id) / "image.png")
    vacant = without_vehicle(pixels, frame)
    assert frame.box_xyxy is not None
    left, _, right, _ = frame.box_xyxy
    grey = (vacant == 128).all((0, 2))
    assert grey[int(left) : int(right)].all()
    assert grey.mean() < 1
    assert np.array_equal(vacant[:, ~grey], pixels[:, ~grey])
    assert grey.sum() == pytest.approx(1.3 * (right - left), abs=2)
