"""The bytes of a tap file: they come back, and hostile ones point nowhere."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rauca_core.render.encoding import UNIT, decode, encode, from_fractions, quantize_rows, to_fractions

TEXELS, PIXELS = 2**31 - 1, 2**31 - 1
rows_of_columns = st.lists(
    st.lists(st.integers(0, TEXELS - 1), min_size=0, max_size=6, unique=True).map(sorted), min_size=0, max_size=8
)


def packed(rows: list[list[int]], pixels: list[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    indptr = np.cumsum([0] + [len(row) for row in rows]).astype(np.int64)
    columns = np.array([c for row in rows for c in row], np.int32)
    return np.array(pixels, np.int32), indptr, columns


@given(rows_of_columns, st.data())
def test_places_come_back(rows: list[list[int]], data: st.DataObject) -> None:
    wanted = st.lists(st.integers(0, PIXELS - 1), min_size=len(rows), max_size=len(rows), unique=True).map(sorted)
    pixels, indptr, columns = packed(rows, data.draw(wanted))
    found = decode(encode(pixels, indptr, columns), len(pixels), len(columns), PIXELS, TEXELS)
    assert found is not None
    for a, b in zip(found, (pixels, indptr, columns), strict=True):
        assert (a == b).all()


@given(st.binary(max_size=64), st.integers(0, 9), st.integers(0, 30))
def test_any_bytes_are_refused_or_point_inside(stream: bytes, rows: int, taps: int) -> None:
    found = decode(np.frombuffer(stream, np.uint8), rows, taps, 100, 50)
    if found is not None:
        pixels, indptr, columns = found
        assert (np.diff(pixels) > 0).all()
        assert indptr[-1] == taps
        assert ((pixels >= 0) & (pixels < 100)).all()
        assert ((columns >= 0) & (columns < 50)).all()


def test_streams_too_short_or_too_long_are_refused() -> None:
    pixels, indptr, columns = packed([[3, 900], [2]], [5, 6])
    stream = encode(pixels, indptr, columns)
    assert decode(stream, 2, 3, 10, 1000) is not None
    assert decode(stream[:-1], 2, 3, 10, 1000) is None
    assert decode(np.append(stream, np.uint8(0)), 2, 3, 10, 1000) is None
    assert decode(stream, 2, 3, 10, 900) is None
    assert decode(stream, 2, 3, 6, 1000) is None
    assert decode(stream, 2, 2, 10, 1000) is None


@given(st.lists(st.lists(st.floats(0, 1), min_size=1, max_size=200), min_size=1, max_size=5))
def test_rows_sum_to_one_after_rounding(rows: list[list[float]]) -> None:
    rows = [row if sum(row) > 1e-3 else [*row, 1.0] for row in rows]
    values = np.concatenate([np.array(row) / sum(row) for row in rows])
    indptr = np.cumsum([0] + [len(row) for row in rows])
    rounded = quantize_rows(indptr, values)
    assert (np.add.reduceat(rounded.astype(np.int64), indptr[:-1]) == UNIT).all()
    assert np.abs(rounded / UNIT - values).max() <= 1.01 / UNIT


def test_rows_that_read_black_keep_their_sum_after_rounding() -> None:
    values = np.full(1000, 0.5 / 1000)  # each rounds up: by themselves they would sum to half a hundredth more
    rounded = quantize_rows(np.array([0, 1000]), values)
    assert abs(int(rounded.sum()) - UNIT / 2) <= 0.5


def test_fractions_are_stable() -> None:
    every = np.arange(UNIT + 1, dtype=np.uint16)
    assert (to_fractions(from_fractions(every)) == every).all()
