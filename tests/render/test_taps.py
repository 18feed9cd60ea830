"""The operator from texels to pixels: its sums, its adjoint, its edges, its files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.render_agreement import to_image
from rauca_core.contract import Camera, RaucaError, Vehicle
from rauca_core.render import Pyramid, Taps, build_taps
from rauca_core.render.merge import Rows, fill_fringe
from rauca_core.render.sparse import _Numba, _Torch
from rauca_core.render.taps import UNIT, from_fractions, quantize_rows, to_fractions
from rauca_core.render.thin import Thinning

MAP = 128


@pytest.fixture
def camera() -> Camera:
    return Camera.look_at(np.array([5.0, 3.5, 2.0]), np.array([0.0, 0.0, 0.7]), 50, 72, 64)


@pytest.mark.parametrize("function", [_Numba, _Torch])
def test_both_paths_multiply_by_the_matrix_and_its_transpose(
    box_vehicle: Vehicle, camera: Camera, function: type[torch.autograd.Function]
) -> None:
    rows = build_taps(box_vehicle, camera, MAP).rows
    dense = torch.zeros(rows.shape, dtype=torch.float64)
    where = np.repeat(np.arange(rows.shape[0]), np.diff(rows.indptr)), rows.columns
    dense.index_put_(tuple(map(torch.from_numpy, where)), torch.from_numpy(rows.weights).double(), accumulate=True)
    x = torch.randn(rows.shape[1], 3, dtype=torch.float64, requires_grad=True)
    y = torch.randn(2 * rows.shape[0], 3, dtype=torch.float64)
    result = function.apply((rows, rows), x)
    assert torch.allclose(result, torch.cat([dense @ x] * 2), atol=1e-12)
    result.backward(y)
    assert torch.allclose(x.grad, dense.T @ (y[: len(dense)] + y[len(dense) :]), atol=1e-12)


def test_occluders_hide_paint(box_vehicle: Vehicle) -> None:
    above = Camera.look_at(np.array([0.0, 0.0, 8.0]), np.zeros(3), 40, 48, 48)
    hidden = build_taps(box_vehicle, above, MAP)  # only the trim on top is seen
    assert hidden.alpha.max(initial=0) < 0.01
    sides = slice(0, 8)
    names = ("triangles", "uvs", "normals", "material")
    open_box = replace(box_vehicle, **{name: getattr(box_vehicle, name)[sides] for name in names})
    assert build_taps(open_box, above, MAP).alpha.max() > 0.9  # the far sides of its walls: nothing is culled


def test_mask_scales_alpha(box_vehicle: Vehicle, camera: Camera) -> None:
    whole = build_taps(box_vehicle, camera, MAP).coverage()
    half = replace(box_vehicle, paint_mask=box_vehicle.paint_mask // 255 * 128)
    assert np.allclose(build_taps(half, camera, MAP).coverage(), whole * (128 / 255), atol=1e-4)


def test_fringe_reads_its_neighbors(box_vehicle: Vehicle, camera: Camera) -> None:
    taps = build_taps(box_vehicle, camera, MAP)
    alpha = taps.coverage()
    listed = np.zeros(alpha.size, bool)
    listed[taps.pixels] = True
    listed = listed.reshape(alpha.shape)
    bare = listed & (alpha == 0)
    assert bare.any()
    painted = np.pad(alpha >= 1 / 16, 2)
    height, width = alpha.shape
    near = np.any([painted[y : y + height, x : x + width] for y in range(5) for x in range(5)], axis=0)
    assert (listed == (near | (alpha > 0))).all()
    pyramid = Pyramid.of(box_vehicle, MAP)
    charts = torch.zeros(3, MAP, MAP)  # every wall a color of its own
    charts[0, :, : MAP // 2] = charts[1, : MAP // 2] = 1
    texels = pyramid.from_map(charts)
    image = to_image(taps, taps.rows(pyramid(texels))).numpy()
    for row, column in np.argwhere(bare)[::7]:
        # Its neighbors' own samples went into it; those reach at most four pixels further.
        window = (slice(max(0, row - 4), row + 5), slice(max(0, column - 4), column + 5))
        around = image[(slice(None), *window)][:, alpha[window] >= 1 / 16]
        assert (image[:, row, column] >= around.min(1) - 1e-5).all()
        assert (image[:, row, column] <= around.max(1) + 1e-5).all()


def test_fringe_weighs_neighbors_by_coverage_over_distance() -> None:
    # One line of pixels: solid with texel 0, faint with texel 1, bare, solid with texel 2.
    rows = Rows(
        np.array([0, 1, 3], np.int32),
        np.array([1.0, 0.01, 0.5], np.float32),
        np.array([0, 1, 2, 3], np.int64),
        np.array([0, 1, 2], np.int32),
        np.ones(3),
    )
    line = Camera(np.eye(3), np.eye(3), np.zeros(3), 6, 1)
    thinning = Thinning.of(Pyramid(np.ones((1, 3), np.float32)).tree, 0.0)
    pixels, alpha, indptr, columns, values = fill_fringe(rows, line, 1 / 16, 3, thinning)
    assert pixels.tolist() == [0, 1, 2, 3, 4, 5]
    assert np.allclose(alpha, [1, 0.01, 0, 0.5, 0, 0])
    matrix = np.zeros((6, 3))
    for row in range(6):
        matrix[row, columns[indptr[row] : indptr[row + 1]]] = values[indptr[row] : indptr[row + 1]]
    shares = {1: (1 / 2, 0.01, 0.5 / 5), 2: (1 / 5, 0.01 / 2, 0.5 / 2), 4: (0, 0, 1), 5: (0, 0, 1)}
    wanted = {0: (1, 0, 0), 3: (0, 0, 1), **{k: np.divide(v, sum(v)) for k, v in shares.items()}}
    assert np.allclose(matrix, [wanted[row] for row in range(6)])


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        ("columns", 5, MAP**2 * 2),
        ("columns", 5, -1),
        ("pixels", -1, 72 * 64),
        ("pixels", 0, -1),
        ("pixels", 3, 0),
        ("indptr", 0, 1),
        ("indptr", 2, 2**40),
        ("indptr", -1, 7),
    ],
)
def test_taps_that_point_outside_are_refused(
    box_vehicle: Vehicle, camera: Camera, tmp_path: Path, name: str, place: int, value: int
) -> None:
    taps = build_taps(box_vehicle, camera, MAP)
    getattr(taps if name == "pixels" else taps.rows, name)[place] = value
    taps.save(tmp_path / "taps.safetensors")
    with pytest.raises(RaucaError, match="damaged"):
        Taps.load(tmp_path / "taps.safetensors")


@given(st.lists(st.lists(st.floats(0, 1), min_size=1, max_size=200), min_size=1, max_size=5))
def test_rows_sum_to_one_after_rounding(rows: list[list[float]]) -> None:
    rows = [row if sum(row) > 1e-3 else [*row, 1.0] for row in rows]
    values = np.concatenate([np.array(row) / sum(row) for row in rows])
    indptr = np.cumsum([0] + [len(row) for row in rows])
    rounded = quantize_rows(indptr, values)
    assert (np.add.reduceat(rounded.astype(np.int64), indptr[:-1]) == UNIT).all()
    assert np.abs(rounded / UNIT - values).max() <= 1.01 / UNIT


def test_fractions_are_stable_and_rows_that_read_black_keep_their_sum() -> None:
    every = np.arange(UNIT + 1, dtype=np.uint16)
    assert (to_fractions(from_fractions(every)) == every).all()
    values = np.full(1000, 0.5 / 1000)  # each rounds up: by themselves they would sum to half a hundredth more
    assert abs(int(quantize_rows(np.array([0, 1000]), values).sum()) - UNIT / 2) <= 0.5


def test_unknown_filter_is_named(box_vehicle: Vehicle, camera: Camera) -> None:
    with pytest.raises(RaucaError, match=r"'mitchell'.*blackman-harris"):
        build_taps(box_vehicle, camera, MAP, filter="mitchell")
