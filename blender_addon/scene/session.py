"""Everything a render needs, in one scene: place, vehicle, weather."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from ..core import contract, seeding
from . import camera, render
from .annotate import Annotation, annotate, geometry_only
from .place import build_place
from .ring import Viewpoint, viewpoint
from .vehicle import SceneVehicle
from .weather import SceneWeather

SIGHT_LINES = 256


class Session:
    """A scene of its own for one plan; the artist's scene is not touched.

    Attributes:
        plan: what is rendered.
        scene: Blender's scene, named ``rauca``.
        place, vehicle, weather: its parts.
    """

    def __init__(self, plan: contract.Plan, vehicle: contract.Vehicle, blend: Path | None = None) -> None:
        """Build the scene; ``blend`` is the user's file when the plan was made in one."""
        self.plan = plan
        self.scene = bpy.data.scenes.new("rauca")
        render.prepare(self.scene)
        if plan.quality.denoise:
            render.require_denoiser(self.scene)
        self.place = build_place(self.scene, plan, blend)
        self.vehicle = SceneVehicle(self.scene, vehicle)
        self.weather = SceneWeather(self.scene, self.place.lamps)
        self._sight_points = _points_on_paint(vehicle, seeding.named_rng(plan.seed, "sight lines"))

    def viewpoint(self, location: int, view: int) -> Viewpoint:
        """The camera of a view, jitter included."""
        return viewpoint(self.plan, location, view, self.place.pose(location), self.vehicle.centre)

    def enter(self, location: int) -> None:
        """Put the vehicle at a location."""
        self.place.enter(location)
        self.vehicle.place(self.place.pose(location))
        self._update()

    def visible(self, location: int, view: int) -> float:
        """Share of sight lines from the camera to points spread evenly over the paint that no other object blocks."""
        eye = Vector(self.viewpoint(location, view).camera.position)
        pose = self.place.pose(location)
        points = self._sight_points @ pose[:3, :3].T + pose[:3, 3]
        depsgraph = self._update()
        clear = 0
        for point in points:
            ray = Vector(point) - eye
            hit, _, _, _, thing, _ = self.scene.ray_cast(depsgraph, eye, ray.normalized(), distance=ray.length)
            clear += not hit or thing.name == self.vehicle.object.name
        return clear / len(points)

    def annotations(self, location: int, views: Iterable[int]) -> dict[int, Annotation]:
        """Coverage and distance of several views of a location."""
        result = {}
        with geometry_only(self.scene, self.vehicle, [self.weather.fog]):
            for view in views:
                camera.place(self.scene, self.viewpoint(location, view).camera)
                result[view] = annotate(self.scene, seeding.named_seed(self.plan.seed, "coverage", location, view))
        return result

    def render(self, location: int, view: int, weather: contract.Weather) -> NDArray[np.float32]:
        """Render the vehicle in its present paint; (H, W, 3) linear. One seed per frame, whatever the paint."""
        camera.place(self.scene, self.viewpoint(location, view).camera)
        pixels = render.render_linear(self.scene, self.plan.quality, self.seed(location, view, weather))
        return pixels[..., :3]

    def seed(self, location: int, view: int, weather: contract.Weather) -> int:
        """The renderer's seed of a frame."""
        return seeding.named_seed(self.plan.seed, "render", location, view, weather.name) % 2**31

    def set_weather(self, weather: contract.Weather) -> None:
        self.weather.apply(weather)
        self.vehicle.light_lamps(weather.is_night)

    def _update(self) -> bpy.types.Depsgraph:
        layer = self.scene.view_layers[0]
        layer.update()
        return layer.depsgraph


def _points_on_paint(vehicle: contract.Vehicle, rng: np.random.Generator) -> NDArray[np.float64]:
    """Points (N, 3) spread evenly over the painted faces' area, vehicle frame."""
    corners = vehicle.positions[vehicle.triangles[vehicle.paint_faces()]].astype(np.float64)
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    faces = rng.choice(len(corners), SIGHT_LINES, p=areas / areas.sum())
    a, b = rng.random((2, SIGHT_LINES, 1))
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    chosen = corners[faces]
    return chosen[:, 0] + a * (chosen[:, 1] - chosen[:, 0]) + b * (chosen[:, 2] - chosen[:, 0])
