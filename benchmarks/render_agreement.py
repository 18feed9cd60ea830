"""How far our taps are from what Cycles sees: coverage masks, UVs, anti-aliased albedo."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from rauca_core.contract import Camera, Progress, Vehicle
from rauca_core.render import Pyramid, Taps, build_taps, rasterize
from rauca_core.render.surface import find_surface

from .harness import Row, Settings, psnr_db
from .in_blender import run_child
from .render_reference import box_of, random_cameras

UV_SIZE = 1024  # texels; at which the UV error is counted
MASK_SUBSAMPLES = (4, 8, 12)
COLOR_SUBSAMPLES = 4
REACH = 2  # pixels around the car that the filter may touch
CELLS = 64  # of the colorful texture, along each axis of the map
SOLID, FAINT = 0.999, 0.02  # coverage above which a pixel is inside; below which it is not compared
Image = NDArray[np.float32]


def to_image(taps: Taps, colors: Tensor) -> Tensor:
    """Colors (R, 3) of the taps' pixels as an image (3, height, width), black elsewhere."""
    black = colors.new_zeros(3, taps.height * taps.width)
    image = black.index_copy(1, torch.from_numpy(taps.pixels.astype(np.int64)), colors.T)
    return image.reshape(3, taps.height, taps.width)


def premultiplied(taps: Taps, texels: Tensor) -> Image:
    """The paint layer (H, W, 3), linear: coverage times coverage-normalized texture, black elsewhere."""
    paint = torch.from_numpy(taps.alpha)[:, None] * taps.rows(texels)
    return to_image(taps, paint).permute(1, 2, 0).contiguous().numpy()


class Job(NamedTuple):
    """One render: ``coverage``, ``premultiplied`` or ``uv``, by the camera of that number."""

    what: str
    camera: int
    samples: int


def render_jobs(
    vehicle: Vehicle,
    cameras: Sequence[Camera],
    uv_map_linear: Image,
    jobs: Sequence[Job],
    progress: Callable[[Progress], None] = lambda news: None,
) -> list[Image]:
    """Render ``jobs`` in `render_in_blender.py`: an image (H, W, 3) linear each, of a linear map (size, size, 3).

    Raises:
        RaucaError: Blender is missing, or died.
    """
    with tempfile.TemporaryDirectory(prefix="rauca-bench-") as temporary:
        folder = Path(temporary)
        vehicle.save(folder / "vehicle")
        np.save(folder / "uv_map_linear.npy", uv_map_linear)
        request = {
            "folder": temporary,
            "cameras_json": [camera.to_json() for camera in cameras],
            "boxes": [box_of(vehicle, camera, REACH) for camera in cameras],
            "jobs": jobs,
        }
        run_child("render_in_blender.main", request, progress, "leave it out with --no-blender")
        return [np.load(folder / f"{number}.npy") for number in range(len(jobs))]


def compare_with_blender(name: str, vehicle: Vehicle, settings: Settings, progress: Callable[[Progress], None]) -> Row:
    """Render all cameras in one Blender process and compare.

    Returns:
        ``iou_mean`` and ``iou_worst``, by subsamples per axis, of the masks at half coverage; ``iou_cycles``, of Cycles
        against itself at a quarter of the samples; ``uv_*``, distance of UVs at pixel centers, texels; ``*_db``, PSNR
        of the premultiplied linear albedo at 4x4; ``floor_*_db``, Cycles against itself at twice the samples.
    """
    pyramid = Pyramid.of(vehicle, UV_SIZE)
    cameras = random_cameras(vehicle, settings.cameras, settings.camera_size)
    uv_map = colorful(pyramid)
    every, colored = range(len(cameras)), range(settings.color_views)
    most, some = settings.mask_samples, settings.color_samples
    jobs = [Job("coverage", i, most) for i in every] + [Job("coverage", i, most // 4) for i in every]
    jobs += [Job("uv", i, 1) for i in every]
    jobs += [Job("premultiplied", i, n) for n in (some, 2 * some) for i in colored]
    images = iter(render_jobs(vehicle, cameras, uv_map, jobs, progress))
    masks, rough = ([next(images)[..., 0] for _ in every] for _ in range(2))
    uvs = [next(images) for _ in every]
    colors, fine = ([next(images) for _ in colored] for _ in range(2))

    ious = {str(n): [_iou(_taps(vehicle, c, pyramid, n).coverage(), m) for c, m in zip(cameras, masks, strict=True)]
            for n in MASK_SUBSAMPLES}  # fmt: skip
    distances = np.concatenate([uv_distances(vehicle, c, u) for c, u in zip(cameras, uvs, strict=True)])
    texels = pyramid(pyramid.from_map(torch.from_numpy(uv_map).permute(2, 0, 1)))
    ours = [premultiplied(_taps(vehicle, cameras[i], pyramid, COLOR_SUBSAMPLES), texels) for i in colored]
    inside, edge = _inside_and_edge(ours, colors, masks)
    floor_inside, floor_edge = _inside_and_edge(colors, fine, masks)
    return {
        "vehicle": name, "cameras": len(cameras), "size": settings.camera_size, "mask_samples": most,
        "color_samples": some,
        "iou_mean": {n: float(np.mean(row)) for n, row in ious.items()},
        "iou_worst": {n: float(np.min(row)) for n, row in ious.items()},
        "iou_cycles": float(np.mean([_iou(a, b) for a, b in zip(rough, masks, strict=True)])),
        "uv_median": float(np.median(distances)), "uv_p99": float(np.percentile(distances, 99)),
        "inside_db": inside, "edge_db": edge, "floor_inside_db": floor_inside, "floor_edge_db": floor_edge,
    }  # fmt: skip


def colorful(pyramid: Pyramid, seed: int = 0) -> Image:
    """A map (size, size, 3), linear, of random colors in square cells; gutters filled as a camouflage's are."""
    cell = pyramid.size // CELLS
    cells = np.random.default_rng(seed).random((3, CELLS, CELLS)).astype(np.float32)
    texels = pyramid.from_map(torch.from_numpy(cells.repeat(cell, 1).repeat(cell, 2)))
    return np.ascontiguousarray(pyramid.to_map(texels).permute(1, 2, 0).numpy())


def uv_distances(vehicle: Vehicle, camera: Camera, theirs: Image) -> NDArray[np.float64]:
    """Texels between our UV and Cycles' (H, W, 3) at each pixel center where both see paint."""
    raster = rasterize(vehicle.positions, vehicle.triangles, camera)
    surface = find_surface(raster, vehicle.paint_faces())
    hit, ours = surface.index >= 0, surface.interpolate(vehicle.uvs)
    height, width = hit.shape
    seen = theirs[raster.y0 : raster.y0 + height, raster.x0 : raster.x0 + width][hit]
    both = seen[:, 2] > 0.5
    return np.asarray(np.linalg.norm(ours - seen[:, :2], axis=1)[both] * UV_SIZE)


def _taps(vehicle: Vehicle, camera: Camera, pyramid: Pyramid, samples: int) -> Taps:
    return build_taps(vehicle, camera, pyramid.size, samples, "blackman-harris", pyramid=pyramid)


def _iou(ours: NDArray[np.float32], theirs: NDArray[np.float32]) -> float:
    a, b = ours >= 0.5, theirs >= 0.5
    return float((a & b).sum() / max((a | b).sum(), 1))


def _inside_and_edge(found: list[Image], wanted: list[Image], masks: list[Image]) -> tuple[float, float]:
    """PSNR over all views, where Cycles sees nothing but paint, and where it sees some."""
    inside, edge = [], []
    for image, reference, mask in zip(found, wanted, masks, strict=False):
        error = (image - reference) ** 2
        inside.append(error[mask > SOLID])
        edge.append(error[(mask > FAINT) & (mask <= SOLID)])
    return psnr_db(np.concatenate(inside)), psnr_db(np.concatenate(edge))
