"""Thinned rows: what they may lose, and what they may not."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from rauca_core.contract import Camera, Vehicle
from rauca_core.render import Pyramid, build_taps
from rauca_core.render.thin import Thinning, thin_row

PRICE = 1e-4


def dense(indptr: np.ndarray, columns: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    matrix = np.zeros((len(indptr) - 1, count))
    np.add.at(matrix, (np.repeat(np.arange(len(indptr) - 1), np.diff(indptr)), columns), values)
    return matrix


def thin(pyramid: Pyramid, rows: list[dict[int, float]], price: float, alpha: float = 1.0) -> np.ndarray:
    """Rows of {place in the pyramid: weight}, thinned; dense over all levels."""
    result = np.zeros((len(rows), pyramid.count))
    how = Thinning.of(pyramid.tree, price)
    for dense, row in zip(result, rows, strict=True):
        places, weights = np.zeros(2 * len(row), np.int32), np.zeros(2 * len(row))
        places[: len(row)], weights[: len(row)] = list(row), list(row.values())
        count = thin_row(places, weights, len(row), alpha, how)
        assert (np.diff(places[:count]) > 0).all()
        dense[places[:count]] = weights[:count]
    assert not how.state.any()
    assert (how.slot == -1).all()
    return result


@pytest.fixture
def pyramid() -> Pyramid:
    return Pyramid(np.ones((8, 8), np.float32))


def test_equal_siblings_become_their_parent(pyramid: Pyramid) -> None:
    block = {int(pyramid.slots[0][y, x]): 1 / 16 for y in range(4) for x in range(4)}
    (row,) = thin(pyramid, [block], PRICE)
    assert np.flatnonzero(row).tolist() == [int(pyramid.slots[2][0, 0])]
    assert row.max() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("before", "price", "alpha", "after"),
    [
        ((0.7, 0.3, 0.0), PRICE, 1.0, (0.7, 0.3, 0.0)),  # unequal siblings stay
        ((0.495, 0.005, 0.5), PRICE, 1.0, (0.5, 0.0, 0.5)),  # a small tap goes to its sibling
        ((0.995, 0.0, 0.005), PRICE, 1.0, (1.0, 0.0, 0.0)),  # or for nothing
        ((0.985, 0.0, 0.015), PRICE, 1.0, (0.985, 0.0, 0.015)),
        ((0.985, 0.0, 0.015), PRICE, 0.5, (1.0, 0.0, 0.0)),  # a faint pixel may err more
        ((0.6, 0.0, 0.4), 10.0, 1.0, (1.0, 0.0, 0.0)),  # the largest never goes
    ],
)
def test_two_siblings_and_a_stranger(
    pyramid: Pyramid, before: tuple[float, ...], price: float, alpha: float, after: tuple[float, ...]
) -> None:
    places = [int(pyramid.slots[0][y, x]) for y, x in ((0, 0), (0, 1), (7, 7))]
    listed = {place: weight for place, weight in zip(places, before, strict=True) if weight > 0}
    (row,) = thin(pyramid, [listed], price, alpha)
    assert row[places].tolist() == pytest.approx(after)
    assert row.sum() == pytest.approx(1.0)


def test_price_zero_changes_nothing(pyramid: Pyramid) -> None:
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.ones(10), 5)
    places = [rng.choice(pyramid.count, 10, replace=False) for _ in weights]
    rows = [dict(zip(p.tolist(), w.tolist(), strict=True)) for p, w in zip(places, weights, strict=True)]
    before = np.zeros((5, pyramid.count))
    for row, p, w in zip(before, places, weights, strict=True):
        row[p] = w
    assert np.allclose(thin(pyramid, rows, 0.0), before, atol=1e-12)


def test_error_stays_within_what_was_paid(box_vehicle: Vehicle) -> None:
    """Squared weight error on the finest texels <= price per tap saved, and rows still sum to 1."""
    camera = Camera.look_at(np.array([9.0, 6.0, 3.0]), np.array([0.0, 0.0, 0.7]), 50, 40, 36)
    size = 64
    pyramid = Pyramid.of(box_vehicle, size)
    identity = pyramid(torch.eye(len(pyramid.texels), dtype=torch.float64)).numpy()  # (T, P)
    whole = build_taps(box_vehicle, camera, size, 6, pyramid=pyramid, thinning=0.0)
    few = build_taps(box_vehicle, camera, size, 6, pyramid=pyramid, thinning=PRICE)
    assert (whole.pixels == few.pixels).all()
    assert len(few.rows.weights) < 0.5 * len(whole.rows.weights)
    full, thinned = (dense(t.rows.indptr, t.rows.columns, t.rows.weights, pyramid.count) for t in (whole, few))
    assert np.allclose(thinned.sum(1), 1, atol=1e-6)
    error = (((full - thinned) @ identity) ** 2).sum(1)
    saved = np.diff(whole.rows.indptr) - np.diff(few.rows.indptr)
    paid = PRICE / np.maximum(whole.alpha, 0.25) ** 2 * saved
    # Errors of nested merges add up as vectors, and normalizing after a drop moves the rest a little.
    assert (error <= 2 * paid + 1e-8).all()
    assert error.mean() < 0.5 * paid.mean()
