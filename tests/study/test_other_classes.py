"""Agreement of two detectors on everything but the vehicle: what counts, and pictures without it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.stability.drawn import make_dataset
from rauca_core.contract import Vehicle
from rauca_core.detect.agreement import Agreement, agreement_of
from rauca_core.detect.found import Found
from rauca_core.runtime.images import read_image
from rauca_core.study.intervals import difference_interval
from rauca_core.study.other_classes import FrameAgreement, OtherClasses
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


def test_a_share_rests_on_places_and_not_on_how_often_an_object_is_painted() -> None:
    """Ten paints show each object ten times: the interval stays that of three places."""

    def at(town: int, location: int, agreed: int, objects: int, paints: int) -> FrameAgreement:
        return FrameAgreement(town, location, Agreement(), Agreement(agreed * paints, objects * paints, 0, 0))

    def some(paints: int) -> OtherClasses:
        shown = [at(1, 0, 3, 3, paints), at(1, 1, 1, 2, paints), at(1, 1, 1, 1, paints), at(2, 0, 2, 2, paints)]
        return OtherClasses((*shown, at(2, 1, 0, 0, paints)))

    once, often = some(1), some(10)
    assert (once.places, len(once.showing), once.both.objects, often.both.objects) == (3, 4, 8, 80)
    assert once.estimate == often.estimate
    assert once.estimate is not None
    assert once.estimate.ap == pytest.approx(7 / 8)
    without_each = np.array([7 / 8, 4 / 5, 5 / 5, 5 / 6])
    assert (once.estimate.low, once.estimate.high) == pytest.approx(difference_interval(without_each, 3, (0, 1)))
    assert 0 < once.estimate.low < 4 / 5
    assert once.estimate.high == 1


def test_one_place_tells_nothing_of_others_and_no_object_nothing_at_all() -> None:
    alone = OtherClasses(tuple(FrameAgreement(1, 0, Agreement(1, 1, 1, 1), Agreement(4, 5, 2, 2)) for _ in range(3)))
    assert alone.estimate is not None
    assert (alone.estimate.ap, alone.estimate.low, alone.estimate.high) == (pytest.approx(15 / 18), 0, 1)
    nothing = OtherClasses((FrameAgreement(1, 0, Agreement(), Agreement()),))
    assert nothing.estimate is None
    assert nothing.told()["agreement"] is None
    agreed = OtherClasses(tuple(FrameAgreement(1, n, Agreement(), Agreement(9, 9, 5, 5)) for n in range(6)))
    assert agreed.estimate is not None
    assert 0.85 < agreed.estimate.low < 0.95  # six places without a dispute do not say that there is none anywhere
    both = OtherClasses.together([alone, nothing])
    assert (len(both.frames), both.estimate) == (4, alone.estimate)
