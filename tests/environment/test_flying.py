"""Pixels that float between a pole and what lies behind it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rauca_core.contract import Camera
from rauca_core.environment.views.lens import FAR_M, Lens
from rauca_core.environment.views.sources import flying

SIZE, WALL_M = 64, 10.0
LEFT, RIGHT = -0.5, 0.5  # of two cameras side by side before a wall, metres
POINT = (32, 30)


def side_by_side(*aside: float) -> list[Lens]:
    return [
        Lens.of(Camera.look_at(np.array([0.0, y, 1.0]), np.array([WALL_M, y, 1.0]), 60.0, SIZE, SIZE)) for y in aside
    ]


def walls(count: int) -> NDArray[np.float32]:
    return np.full((count, SIZE, SIZE), WALL_M, np.float32)


def seen_at(lens: Lens, other: Lens, pixel: tuple[int, int], metres: float) -> tuple[int, int]:
    """Row and column in the other view of what this one has at a pixel."""
    x, y, w = (lens.to(other) @ [metres * (pixel[1] + 0.5), metres * (pixel[0] + 0.5), metres, 1.0]).tolist()
    return int(y / w), int(x / w)


def test_a_point_that_another_view_looks_through_flies() -> None:
    depth = walls(2)
    depth[0][POINT] = 5.0
    found = flying(side_by_side(LEFT, RIGHT), depth)
    assert np.argwhere(found).tolist() == [[0, *POINT]]


def test_a_point_that_another_view_has_too_stays() -> None:
    lenses, depth = side_by_side(LEFT, RIGHT), walls(2)
    depth[0][POINT] = 5.0
    row, column = seen_at(lenses[0], lenses[1], POINT, 5.0)
    depth[1, row - 1 : row + 2, column - 1 : column + 2] = 5.0
    assert not flying(lenses, depth)[0].any()


def test_one_that_confirms_outweighs_one_that_looks_through() -> None:
    lenses, depth = side_by_side(LEFT, RIGHT, 0.0), walls(3)
    depth[0][POINT] = 5.0
    row, column = seen_at(lenses[0], lenses[1], POINT, 5.0)
    depth[1, row - 1 : row + 2, column - 1 : column + 2] = 5.0
    assert not flying(lenses, depth)[0].any()


@pytest.mark.parametrize("other", [0.0, 2.0])
def test_what_others_do_not_see_is_not_judged(other: float) -> None:
    """Their pixels there are not to be used, or something nearer hides the point."""
    lenses, depth = side_by_side(LEFT, RIGHT), walls(2)
    depth[0][POINT], depth[1] = 5.0, other
    assert not flying(lenses, depth)[0].any()


def test_sky_and_unknown_pixels_never_fly() -> None:
    depth = walls(2)
    depth[0, :8], depth[0, 8:16] = FAR_M, 0.0
    assert not flying(side_by_side(LEFT, RIGHT), depth)[0, :16].any()


def test_one_view_alone_is_taken_at_its_word() -> None:
    assert not flying(side_by_side(LEFT), walls(1)).any()
