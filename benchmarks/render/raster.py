"""Our rasterizer against Embree: who finds the visible face of every pixel sooner."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

import numpy as np

from rauca_core.render import rasterize

from .embree import box_of, ray_directions
from .scenes import Scene
from .speed import elapsed_ms


@dataclass(frozen=True)
class RasterTime:
    """Medians over a ring's views, one sample per pixel.

    Attributes:
        ours_ms: ``rasterize``, vertex transform included.
        embree_ms: the query alone, of rays made beforehand through the pixels of the car's box, tree built beforehand.
        trimesh_ms: the same through trimesh's ``intersects_first``, which copies and normalizes the rays.
        same_face: share of the box's pixels for which both name the same face.
    """

    vehicle: str
    ring: str
    size: int
    rays: int
    ours_ms: float
    embree_ms: float
    trimesh_ms: float
    same_face: float

    @property
    def ratio(self) -> float:
        """To Embree as trimesh serves it."""
        return self.ours_ms / self.trimesh_ms

    @property
    def bare_ratio(self) -> float:
        """To Embree's query alone."""
        return self.ours_ms / self.embree_ms

    def to_json(self) -> dict[str, Any]:
        return {**asdict(self), "ratio": self.ratio, "bare_ratio": self.bare_ratio}


def time_raster(scene: Scene, repeats: int, moved: Callable[[], None]) -> RasterTime:
    """Time both on every view of a scene, interleaved."""
    vehicle, caster = scene.car.vehicle, scene.car.caster
    rows = []
    for camera in scene.cameras:
        x0, y0, x1, y1 = box_of(vehicle, camera)
        x, y = (a.ravel() for a in np.meshgrid(np.arange(x0, x1) + 0.5, np.arange(y0, y1) + 0.5))
        directions = ray_directions(camera, x, y).astype(np.float32)
        origins = np.broadcast_to(camera.position.astype(np.float32), directions.shape).copy()
        works: list[Callable[[], object]] = [
            lambda c=camera: rasterize(vehicle.positions, vehicle.triangles, c),  # type: ignore[misc]
            lambda o=origins, d=directions: caster.first_faces(o, d),  # type: ignore[misc]
            lambda o=origins, d=directions: caster.intersector.intersects_first(o, d),  # type: ignore[misc]
        ]
        times = np.median([[elapsed_ms(work) for work in works] for _ in range(repeats + 1)][1:], axis=0)
        whole = rasterize(vehicle.positions, vehicle.triangles, camera).whole(camera.width, camera.height)
        theirs = caster.first_faces(origins, directions).reshape(y1 - y0, x1 - x0)
        rows.append((len(directions), *times, float((whole[y0:y1, x0:x1] == theirs).mean())))
        moved()
    rays, ours, embree, trimesh, same = (float(median(column)) for column in zip(*rows, strict=True))
    return RasterTime(scene.car.name, scene.ring, scene.size, int(rays), ours, embree, trimesh, same)
