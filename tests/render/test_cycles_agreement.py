"""The taps against the renderer whose frames they explain."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from benchmarks.render_agreement import Job, render_jobs, to_image
from rauca_core.contract import Camera, Vehicle, load_vehicle
from rauca_core.contract.assets import assets_folder
from rauca_core.render import Pyramid, build_taps
from rauca_core.runtime.images import read_image

SIZE = 256  # at half this, pixels at exactly half coverage decide the overlap
MAP = 512


@pytest.fixture(scope="module")
def sedan() -> Vehicle:
    return load_vehicle(assets_folder() / "vehicles" / "sedan", read_image)


def cycles(vehicle: Vehicle, camera: Camera, uv_map: np.ndarray) -> dict[str, np.ndarray]:
    pytest.importorskip("bpy", reason="Blender as a module is not installed")
    coverage, premultiplied = render_jobs(
        vehicle, [camera], uv_map, [Job("coverage", 0, 256), Job("premultiplied", 0, 256)]
    )
    return {"coverage": coverage[..., 0], "premultiplied": premultiplied}


def psnr(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(-10 * np.log10(np.mean((found - wanted) ** 2)))


@pytest.mark.parametrize(("azimuth", "elevation", "distance"), [(40, 20, 7), (200, 45, 5)])
def test_taps_agree_with_cycles(sedan: Vehicle, azimuth: float, elevation: float, distance: float) -> None:
    a, e = np.radians([azimuth, elevation])
    aim = np.array([0.0, 0.0, 0.7])
    eye = aim + distance * np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
    camera = Camera.look_at(eye, aim, 50, SIZE, SIZE)
    pyramid = Pyramid.of(sedan, MAP)
    cells = np.random.default_rng(0).random((3, MAP // 8, MAP // 8)).astype(np.float32)
    texels = pyramid.from_map(torch.from_numpy(cells.repeat(8, 1).repeat(8, 2)))
    # As a camouflage is exported: gutters filled from the paint beside them.
    uv_map = pyramid.to_map(texels).permute(1, 2, 0).numpy()
    reference = cycles(sedan, camera, uv_map)

    taps = build_taps(sedan, camera, MAP, samples=4, pyramid=pyramid)
    alpha = taps.coverage()
    x_bar = to_image(taps, taps.rows(pyramid(texels))).permute(1, 2, 0).numpy()

    seen, wanted = alpha >= 0.5, reference["coverage"] >= 0.5
    iou = (seen & wanted).sum() / (seen | wanted).sum()
    assert iou >= 0.995
    assert psnr(alpha, reference["coverage"]) > 45
    inside = reference["coverage"] > 0.999
    edge = (reference["coverage"] > 0.02) & ~inside
    premultiplied = alpha[..., None] * x_bar
    assert psnr(premultiplied[inside], reference["premultiplied"][inside]) > 43
    assert psnr(premultiplied[edge], reference["premultiplied"][edge]) > 35
    # What the light maps of an edge multiply: the coverage-normalized texture, fallback rows included.
    normalized = reference["premultiplied"][edge] / reference["coverage"][edge, None]
    weighted = reference["coverage"][edge, None] * (x_bar[edge] - normalized)
    assert -10 * np.log10(np.mean(weighted**2)) > 30


def test_box_filter_is_further_from_cycles(sedan: Vehicle) -> None:
    camera = Camera.look_at(np.array([5.0, 4.0, 2.5]), np.array([0, 0, 0.7]), 50, 96, 96)
    reference = cycles(sedan, camera, np.ones((MAP, MAP, 3), np.float32))["coverage"]
    gap = [psnr(build_taps(sedan, camera, MAP, 4, f).coverage(), reference) for f in ("blackman-harris", "box")]
    assert gap[0] > gap[1] + 6
