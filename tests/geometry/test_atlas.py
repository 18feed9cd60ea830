"""Texel coverage, atlas figures and unwrapping, against brute force and against atlases with known faults."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rauca_core.contract import Material, RaucaError
from rauca_core.geometry import chart_mask, covered, unwrap
from rauca_core.geometry.pack import Footprint, _collisions, _runs, _stride
from tests.atlas_report import atlas_report


def brute_force(uv: np.ndarray, size: int, conservative: bool) -> set[int]:
    """Texels of one triangle by testing 33 x 33 points of every texel, or its center alone."""
    a, b, c = uv
    offsets = np.linspace(0, 1, 33) if conservative else np.array([0.5])
    found = set()
    for row in range(size):
        for column in range(size):
            x, y = np.meshgrid((column + offsets) / size, 1 - (row + offsets) / size)
            sides = [(q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]) for p, q in ((a, b), (b, c), (c, a))]
            if any(np.all([s > 0 for s in sides], axis=0).ravel() | np.all([s < 0 for s in sides], axis=0).ravel()):
                found.add(row * size + column)
    return found


@pytest.mark.parametrize("seed", range(5))
def test_coverage_agrees_with_brute_force(seed):
    uv = np.random.default_rng(seed).random((3, 2))
    centers, _ = covered(uv[None], 16, conservative=False)
    assert set(centers.tolist()) == brute_force(uv, 16, False)
    touched, _ = covered(uv[None], 16, conservative=True)
    sampled = brute_force(uv, 16, True)
    assert sampled <= set(touched.tolist())  # nothing missed; slivers between the sample points may come on top
    assert len(touched) <= len(sampled) + 6


def test_texels_on_a_shared_edge_are_no_overlap(box_vehicle):
    report = atlas_report(box_vehicle)
    assert report.overlap == 0.0
    assert report.charts == 4
    assert report.worst_spread == pytest.approx(0.0, abs=1e-4)  # a square of UV on a rectangle is even, if stretched
    assert report.utilisation == pytest.approx(4 * 0.4**2, abs=0.05)
    assert (report.out_of_range, report.degenerate) == (0, 0)


def test_report_sees_overlap_range_and_uneven_density(box_vehicle):
    uvs = box_vehicle.uvs.copy()
    uvs[2:4] = uvs[0:2]
    assert atlas_report(replace(box_vehicle, uvs=uvs)).overlap == pytest.approx(1 / 3, abs=0.01)
    shifted = box_vehicle.uvs.copy()
    shifted[0:2, :, 0] -= 0.1
    assert atlas_report(replace(box_vehicle, uvs=shifted)).out_of_range == 3
    uneven = box_vehicle.uvs.copy()
    uneven[0, 1, 0] -= 0.15  # one of the square's two triangles shrinks
    assert atlas_report(replace(box_vehicle, uvs=uneven)).worst_spread > 0.02


def test_report_measures_padding(box_vehicle):
    uvs = box_vehicle.uvs.copy()
    size = len(box_vehicle.paint_mask)
    uvs[2:4, :, 0] += (0.45 + 3.0 / size) - uvs[2:4, :, 0].min()  # both edges inside texels: two lie between
    assert atlas_report(replace(box_vehicle, uvs=uvs)).padding_texels == 2


def test_unwrap_gives_a_fresh_box_a_clean_atlas(box_vehicle):
    broken = replace(box_vehicle, uvs=np.zeros_like(box_vehicle.uvs))
    fresh = unwrap(broken, size=256)
    report = atlas_report(fresh)
    assert (report.overlap, report.out_of_range, report.degenerate) == (0.0, 0, 0)
    assert report.padding_texels >= 4
    assert report.border_texels >= 4
    assert report.worst_spread < 0.001
    assert report.density_of_charts < 0.001
    assert report.utilisation > 0.5
    assert (fresh.uvs[~fresh.paint_faces()] == 0).all()
    assert unwrap(broken, size=256).atlas_id == fresh.atlas_id


def test_groups_never_share_a_chart(box_vehicle):
    corner_to_corner = unwrap(box_vehicle, size=256, groups=np.arange(len(box_vehicle.triangles)))
    assert atlas_report(corner_to_corner).charts == int(box_vehicle.paint_faces().sum())


def test_mask_is_all_paint_wherever_a_bilinear_read_on_a_face_looks():
    uvs = np.random.default_rng(1).uniform(0.2, 0.8, (6, 3, 2))
    mask = chart_mask(uvs, 64)
    weights = np.random.default_rng(2).dirichlet([0.3] * 3, 4000)
    points = np.einsum("nk,fkc->nfc", weights, uvs).reshape(-1, 2)
    column, row = points[:, 0] * 64 - 0.5, (1 - points[:, 1]) * 64 - 0.5
    for right in (0, 1):
        for down in (0, 1):
            assert (mask[np.floor(row).astype(int) + down, np.floor(column).astype(int) + right] == 255).all()
    assert set(np.unique(mask)) == {0, 255}


def test_a_vehicle_without_paint_is_refused_in_one_line(box_vehicle):
    bare = replace(box_vehicle, materials=[Material("a", "trim"), Material("b", "trim")])
    with pytest.raises(RaucaError, match="no face has a paint material") as caught:
        unwrap(bare)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("cells", "height", "width"), [(13, 4, 5), (16, 1, 16), (29, 29, 7), (64, 9, 3), (3, 3, 3)])
def test_collisions_are_those_of_trying_every_place(cells: int, height: int, width: int) -> None:
    rng = np.random.default_rng(cells)
    for share in (0.0, 0.02, 0.2, 1.0):
        taken = rng.random((cells, cells)) < share
        for filled in (0.3, 0.9, 1.0):
            mask = rng.random((height, width)) < filled
            footprint = Footprint(np.zeros((0, 3, 2)), mask, _runs(mask, cells))
            found = _collisions(np.pad(taken, ((0, 0), (0, _stride(cells) - cells))), footprint)
            for row in range(cells - height + 1):
                for column in range(cells - width + 1):
                    there = taken[row : row + height, column : column + width]
                    assert found[row, column] == bool((there & mask).any())
