"""Patches are as wide on the vehicle as was asked, over all seams: measured on the finished map, not on the patches."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from rauca_core.attack.naturalness import Naturalness
from rauca_core.attack.naturalness.granulometry import measure_patches
from rauca_core.attack.naturalness.patches import Patches, TexelPoints, link, make_patches, mirrored
from rauca_core.attack.naturalness.texture import Constraints, NaturalColors, finish
from rauca_core.contract import Vehicle, load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.render import Pyramid
from rauca_core.runtime.images import read_image

SIZE = 128


def stripes(width_m: float) -> np.ndarray:
    """Upright stripes on the box's sides: a chart is 0.4 of the map and 4 m (long sides) or 2 m wide."""
    uv_map = np.zeros((1024, 1024, 3), np.uint8)
    for i, length in enumerate((4.0, 2.0, 4.0, 2.0)):
        u, v = 0.05 + 0.5 * (i % 2), 0.05 + 0.5 * (i // 2 % 2)
        columns = np.arange(int(u * 1024) - 20, int((u + 0.4) * 1024) + 20)
        metres = (columns / 1024 - u) / 0.4 * length
        colors = np.where((np.floor(metres / width_m) % 2 == 0)[:, None], (200, 10, 10), (10, 200, 10))
        uv_map[int((1 - v - 0.4) * 1024) - 20 : int((1 - v) * 1024) + 20, columns] = colors
    return uv_map


@pytest.mark.parametrize("width_m", [0.25, 0.5])
def test_the_measure_finds_the_width_of_stripes(box_vehicle: Vehicle, width_m: float) -> None:
    box_vehicle.paint_mask[:] = 255
    found = measure_patches(box_vehicle, stripes(width_m), 0.02)
    assert found.smallest == pytest.approx(width_m, abs=0.05)
    assert found.median == pytest.approx(width_m, abs=0.05)


def test_the_measure_sees_crumbs_and_one_color(box_vehicle: Vehicle) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)
    assert measure_patches(box_vehicle, noise, 0.05).smallest < 0.15  # a texel is 0.06 x 0.16 m
    assert measure_patches(box_vehicle, np.full((64, 64, 3), 9, np.uint8), 0.05).smallest == np.inf


def painted(vehicle: Vehicle, size: int, feature_cm: float | None, **more: object) -> tuple[np.ndarray, Constraints]:
    atlas, wanted = Pyramid.of(vehicle, size), Naturalness(feature_cm=feature_cm, **more)  # type: ignore[arg-type]
    constraints = Constraints(vehicle, atlas, wanted, 0)
    texture = NaturalColors(constraints, torch.rand(constraints.count, 3, generator=torch.Generator().manual_seed(0)))
    uv_map, facts = finish(constraints, texture.texels())
    assert facts.get("patches", len(atlas.texels)) == constraints.count
    return uv_map, constraints


@pytest.mark.parametrize(("feature_cm", "palette"), [(40.0, ()), (80.0, ("#202020", "#808080", "#e0d0a0"))])
def test_patches_of_the_sedan_hold_the_disc(feature_cm: float, palette: tuple[str, ...]) -> None:
    vehicle = load_vehicle(assets_folder() / "vehicles" / "sedan", read_image)
    uv_map, _ = painted(vehicle, 256, feature_cm, palette=palette)
    cube = feature_cm / 1000
    found = measure_patches(vehicle, uv_map, cube)
    assert found.smallest > feature_cm / 100 - 2 * cube  # the measure's own doubt
    assert palette or found.median < 2 * feature_cm / 100
    assert found.edges < 0.3


def test_patches_run_on_over_seams(box_vehicle: Vehicle) -> None:
    """The box's sides are four charts: beside an upright edge both hold the same patch."""
    box_vehicle.paint_mask[:] = 255
    _, constraints = painted(box_vehicle, SIZE, 60.0)
    patches, points = constraints.patches, constraints.points
    assert patches is not None
    corner = (np.abs(points.positions[:, 0] - 2) < 0.1) & (np.abs(points.positions[:, 1] - 1) < 0.1)
    long_side = points.normals[:, 1] > 0.9
    agree = []
    for texel in np.flatnonzero(corner & long_side):
        others = np.flatnonzero(corner & ~long_side)
        across = others[np.abs(points.positions[others, 2] - points.positions[texel, 2]).argmin()]
        agree.append(patches.of_texel[texel] == patches.of_texel[across])
    assert len(agree) > 10
    assert np.mean(agree) > 0.8  # but where one patch ends beside the edge


def test_seeds_keep_their_distance_and_patches_hang_together(box_vehicle: Vehicle) -> None:
    atlas = Pyramid.of(box_vehicle, SIZE)
    points = TexelPoints.of(box_vehicle, atlas)
    links = link(points, atlas.texels, SIZE)
    patches = make_patches(points, links, 0.5, 0)
    seeds = points.positions[patches.seeds]
    same_side = points.normals[patches.seeds] @ points.normals[patches.seeds].T > 0.9
    apart = np.linalg.norm(seeds[:, None] - seeds[None], axis=2)
    assert apart[same_side & ~np.eye(len(seeds), dtype=bool)].min() >= 0.5
    rows = np.repeat(np.arange(len(points.sides)), np.diff(links.indptr))
    inside = patches.of_texel[rows] == patches.of_texel[links.neighbors]
    graph = coo_array((inside[inside], (rows[inside], links.neighbors[inside])), (len(points.sides),) * 2)
    assert connected_components(graph, directed=False)[0] == patches.count


@pytest.mark.parametrize("feature_cm", [10.0, None])
def test_the_sedans_sides_are_mirror_images(feature_cm: float | None) -> None:
    vehicle = load_vehicle(assets_folder() / "vehicles" / "sedan", read_image)
    uv_map, constraints = painted(vehicle, 256, feature_cm, symmetric=True)
    _, free = painted(vehicle, 256, feature_cm)
    assert 0.45 < constraints.count / free.count < 0.65
    points, colors = constraints.points, uv_map.reshape(-1, 3)[constraints.atlas.texels]
    left = points.positions[:, 1] > 0
    placed = np.concatenate([points.positions, points.normals / 10], 1)
    apart, twin = cKDTree(placed[left]).query(placed[~left] * (1, -1, 1, 1, -1, 1))
    close = apart < 0.02
    assert close.mean() > 0.8
    assert (colors[left][twin] == colors[~left]).all(1)[close].mean() > 0.99


def test_paint_without_a_counterpart_keeps_its_patches(box_vehicle: Vehicle) -> None:
    atlas = Pyramid.of(box_vehicle, SIZE)
    points = TexelPoints.of(box_vehicle, atlas)
    one_sided = replace(points, positions=points.positions - (0.0, 5.0, 0.0))
    every = np.arange(len(atlas.texels))
    alone = mirrored(Patches(every.astype(np.int32), every), one_sided)
    np.testing.assert_array_equal(alone.of_texel, every)


def test_texels_know_their_place_and_area(box_vehicle: Vehicle) -> None:
    box_vehicle.paint_mask[:] = 255
    points = TexelPoints.of(box_vehicle, Pyramid.of(box_vehicle, SIZE))
    assert points.areas.sum() == pytest.approx(2 * (4 + 2) * 1.5, rel=0.02)
    long_side = points.normals[:, 1] < -0.9
    np.testing.assert_allclose(points.positions[long_side, 1], -1.0, atol=1e-6)
    np.testing.assert_allclose(points.steps[long_side].mean(0), (1.5 / (0.4 * SIZE), 4 / (0.4 * SIZE)), rtol=1e-3)


def test_sizes_beyond_the_vehicle_and_below_a_texel(box_vehicle: Vehicle, tmp_path: Path) -> None:
    box_vehicle.paint_mask[:] = 255
    _, one = painted(box_vehicle, SIZE, 5000.0)
    assert one.count == 1  # its sides meet at the edges: one part, one patch
    _, free = painted(box_vehicle, SIZE, 0.01)
    assert free.count == len(free.atlas.texels)
