"""Everything a render needs, in one scene: place, vehicle, weather."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract, seeding
from . import camera, composed_fog, render
from .annotate import Annotation, geometry_only
from .lamps import VehicleLamps
from .light_memory import LightMemory
from .place import build_place
from .ring import Viewpoint, viewpoint
from .vehicle import SceneVehicle
from .visibility import PaintVisibility
from .weather import SceneWeather


class Session:
    """A scene of its own for one plan; the artist's scene is not touched.

    Attributes:
        plan: what is rendered.
        scene: Blender's scene, named ``rauca``.
        place, vehicle, weather: its parts.
        memory: renders that later frames use again.
    """

    def __init__(self, plan: contract.Plan, vehicle: contract.Vehicle, blend: Path | None = None) -> None:
        """Build the scene; ``blend`` is the user's file when the plan was made in one."""
        self.plan = plan
        self.scene = bpy.data.scenes.new("rauca")
        render.prepare(self.scene)
        if plan.quality.denoise:
            render.require_denoiser(self.scene)
        self.place = build_place(self.scene, plan, blend, vehicle.category)
        self.vehicle = SceneVehicle(self.scene, vehicle, plan.finish)
        self.weather = SceneWeather(self.scene, self.place.lamps)
        self._beams = VehicleLamps(self.scene, self.vehicle.object, vehicle)
        self.memory = LightMemory(plan)
        self._visibility = PaintVisibility(vehicle)

    def viewpoint(self, location: int, view: int) -> Viewpoint:
        """The camera of a view, jitter included."""
        return viewpoint(self.plan, location, view, self.place.pose(location), self.vehicle.center)

    def enter(self, location: int) -> None:
        """Put the vehicle at a location."""
        self.place.enter(location)
        pose = self.place.pose(location)
        self.vehicle.place(pose)
        if self.plan.scenery.kind != "town":  # which lies on z = 0, all of it inside the box
            self.weather.fog.location = pose[:3, 3]
        self._update()

    def annotations(self, location: int, views: Iterable[int]) -> dict[int, Annotation]:
        """What several views of a location see, whatever the weather."""
        result = {}
        pose = self.place.pose(location)
        with geometry_only(self.scene, self.vehicle, [self.weather.fog]) as geometry:
            for view in views:
                seen_by = self.viewpoint(location, view).camera
                camera.place(self.scene, seen_by)
                ids = geometry.ids()
                visible = self._visibility.share(seen_by.relative_to(pose), ids.instances)
                seed = seeding.named_seed(self.plan.seed, "coverage", location, view)
                result[view] = geometry.annotate(ids, visible, seed)
        return result

    def render(
        self, location: int, view: int, weather: contract.Weather, crop: render.Crop | None = None
    ) -> NDArray[np.float32]:
        """Render the vehicle in its present paint; (H, W, 3) linear. One seed per frame, whatever the paint.

        Args:
            crop: the part of the frame that is wanted; all of it by default.
        """
        camera.place(self.scene, self.viewpoint(location, view).camera)
        pixels = render.render_linear(self.scene, self.plan.quality, self.seed(location, view, weather), crop)
        return pixels[..., :3]

    def render_coarse(self, location: int, view: int, weather: contract.Weather) -> NDArray[np.float32]:
        """The same on composed fog's coarse grid: few pixels of many samples each."""
        quality = self.plan.quality
        camera.place(self.scene, composed_fog.coarse_camera(self.viewpoint(location, view).camera))
        many = replace(quality, samples=composed_fog.COARSE_SAMPLES * quality.samples)
        return render.render_linear(self.scene, many, self.seed(location, view, weather))[..., :3]

    def seed(self, location: int, view: int, weather: contract.Weather) -> int:
        """The renderer's seed of a frame: weathers of one light give equal renders."""
        return seeding.named_seed(self.plan.seed, "render", location, view, *weather.light_key()) % 2**31

    def set_weather(self, weather: contract.Weather) -> None:
        self.weather.apply(weather)
        self.vehicle.light_lamps(weather.lamps)
        self._beams.shine(weather.lamps)
        self.place.light_windows(weather.lamps)

    def _update(self) -> bpy.types.Depsgraph:
        layer = self.scene.view_layers[0]
        layer.update()
        return layer.depsgraph
