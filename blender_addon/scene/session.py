"""Everything a render needs, in one scene: place, vehicle, weather; and renders that later frames ask for again."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ..core import contract, seeding, viewpoints
from . import camera, composed_fog, driving, render
from .annotate import Annotation, PaintVisibility, geometry_only
from .composed_fog import is_composed
from .town import Town
from .user_scene import UserScene
from .vehicle import SceneVehicle
from .weather import SceneWeather, add_beams, shine

MOST_BYTES = 256 << 20  # about a hundred views of 320 x 320


Place = Town | UserScene  # the surroundings of a data set, inside a scene


def build_place(scene: bpy.types.Scene, plan: contract.Plan, blend: Path | None, own: str = "car") -> Place:
    """Add the plan's surroundings to the scene.

    Args:
        blend: the user's file when the plan was made with one.
        own: class of the data set's vehicle, of which nothing else may be.

    Raises:
        RaucaError: the file is missing, is not the one the plan was made with, or marks no location.
    """
    if plan.scenery.kind == "town":
        return Town(scene, plan.seed, own)
    if blend is None:
        raise contract.RaucaError(f"this data set was made in {plan.scenery.name}; give that file as --scene")
    if contract.Scenery.of_file(blend) != plan.scenery:
        raise contract.RaucaError(f"{blend}: not the scene this data set was made in ({plan.scenery.name})")
    return UserScene(scene, blend, plan.locations, own)


class PaintLight(NamedTuple):
    """Radiance of a view, (H, W, 3) linear each: what paint of albedo one adds, and what is there with black paint."""

    gain: NDArray[np.float32]
    black: NDArray[np.float32]


class LightMemory:
    """Renders of one location and one light, with and without fog: frames come in that order.

    Another location or light empties it, so that memory stays flat. It only saves time: what is asked for again and
    gone is rendered again, to the same bytes, as seeds depend on the light and not on the weather's name.
    """

    def __init__(self, plan: contract.Plan) -> None:
        self._kept: dict[tuple[float, ...], PaintLight] = {}
        self._present: tuple[float, ...] = ()
        self._wanted = _wanted_again(plan.weathers, plan.quality) if plan.light else set()

    def get(self, location: int, view: int, weather: contract.Weather) -> PaintLight | None:
        """The light kept for a camera and a weather, if any."""
        return self._kept.get((location, view, *weather.light_key()))

    def keep(self, location: int, view: int, weather: contract.Weather, light: PaintLight) -> None:
        """Keep it if another weather of the plan will want it."""
        if weather.light_key() not in self._wanted:
            return
        present = (location, *clear(weather).light_key())
        if present != self._present:
            self._kept.clear()
            self._present = present
        if (len(self._kept) + 1) * (light.gain.nbytes + light.black.nbytes) <= MOST_BYTES:
            self._kept[(location, view, *weather.light_key())] = light


def clear(weather: contract.Weather) -> contract.Weather:
    """The same light without fog."""
    return replace(weather, fog_density=0.0)


def _wanted_again(weathers: Sequence[contract.Weather], quality: contract.Quality) -> set[tuple[float, ...]]:
    """Lights that two weathers share, or that fog is composed on."""
    keys = [weather.light_key() for weather in weathers]
    shared = {key for key in keys if keys.count(key) > 1}
    return shared | {clear(weather).light_key() for weather in weathers if is_composed(quality, weather)}


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
            render.require_denoiser()
        self.place = build_place(self.scene, plan, blend, vehicle.category)
        self.vehicle = SceneVehicle(self.scene, vehicle, plan.finish)
        self.weather = SceneWeather(self.scene, self.place.lamps)
        self._beams = add_beams(self.scene, self.vehicle.object, vehicle)
        self.memory = LightMemory(plan)
        self._visibility = PaintVisibility(vehicle)
        self._entered: int | None = None
        self._weather: contract.Weather | None = None

    def viewpoint(self, location: int, view: int) -> viewpoints.Viewpoint:
        """The camera of a view, jitter included."""
        if self.plan.clips is not None:
            return self._driven(self.plan.clips, location, view)[0]
        return viewpoints.viewpoint(self.plan, location, view, self.place.pose(location), self.vehicle.center)

    def pose(self, location: int, view: int) -> NDArray[np.float64]:
        """(4, 4) the vehicle to world in a view."""
        if self.plan.clips is not None:
            return self._driven(self.plan.clips, location, view)[1]
        return self.place.pose(location)

    def _driven(
        self, clips: contract.Clips, location: int, view: int, later_s: float = 0.0
    ) -> tuple[viewpoints.Viewpoint, NDArray[np.float64]]:
        street = self.place.street(location)
        return viewpoints.driven(self.plan, clips, view, street, self.vehicle.center, later_s)

    def _aim(self, location: int, view: int, seen_by: contract.Camera) -> None:
        """Look through a camera of a view; in a clip, camera and vehicle are where the view has them, and move."""
        camera.place(self.scene, seen_by)
        clips = self.plan.clips
        if clips is None:
            return
        seen = {frame: self._driven(clips, location, view, time) for frame, time in driving.keys(clips).items()}
        ways = {
            self.scene.camera: {frame: camera.stand(one.camera) for frame, (one, _) in seen.items()},
            self.vehicle.object: {frame: Matrix(pose.tolist()) for frame, (_, pose) in seen.items()},
        }
        driving.move(self.scene, ways, clips)

    def enter(self, location: int) -> None:
        """Put the vehicle at a location, if it is not there; its weather is to be set anew."""
        if location == self._entered:
            return
        self._entered = self._weather = None  # until all is done: an exception on the way leaves the scene between two
        self.place.enter(location)
        pose = self.place.pose(location)
        self.vehicle.place(pose)
        if self.plan.scenery.kind != "town":  # which lies on z = 0, all of it inside the box
            self.weather.fog.location = pose[:3, 3]
        self.scene.view_layers[0].update()
        clips = self.plan.clips
        if clips is not None:
            street = self.place.street(location)
            where = f"clips at location {location}"
            driving.require_free_ways(self.scene, self.vehicle.object, street, clips, clips.manoeuvres, where)
        self._entered = location

    def annotations(self, location: int, views: Iterable[int]) -> dict[int, Annotation]:
        """What several views of a location see, whatever the weather."""
        result = {}
        with geometry_only(self.scene, self.vehicle, [self.weather.fog]) as geometry:
            for view in views:
                seen_by = self.viewpoint(location, view).camera
                self._aim(location, view, seen_by)
                visible = partial(self._visibility.share, seen_by.relative_to(self.pose(location, view)))
                seed = seeding.named_seed(self.plan.seed, "coverage", location, view)
                result[view] = geometry.annotate(visible, seed)
        return result

    def render(
        self, location: int, view: int, weather: contract.Weather, crop: render.Crop | None = None
    ) -> NDArray[np.float32]:
        """Render the vehicle in its present paint; (H, W, 3) linear. One seed per frame, whatever the paint.

        Args:
            crop: the part of the frame that is wanted; all of it by default.
        """
        self._aim(location, view, self.viewpoint(location, view).camera)
        pixels = render.render_linear(self.scene, self.plan.quality, self.seed(location, view, weather), crop)
        return pixels[..., :3]

    def render_coarse(self, location: int, view: int, weather: contract.Weather) -> NDArray[np.float32]:
        """The same on composed fog's coarse grid: few pixels of many samples each."""
        quality = self.plan.quality
        self._aim(location, view, composed_fog.coarse_camera(self.viewpoint(location, view).camera))
        many = replace(quality, samples=composed_fog.COARSE_SAMPLES * quality.samples)
        return render.render_linear(self.scene, many, self.seed(location, view, weather))[..., :3]

    def seed(self, location: int, view: int, weather: contract.Weather) -> int:
        """The renderer's seed of a frame: weathers of one light give equal renders."""
        return seeding.named_seed(self.plan.seed, "render", location, view, *weather.light_key()) % 2**31

    def set_weather(self, weather: contract.Weather) -> None:
        """Set it, if another one is."""
        if weather == self._weather:
            return
        self._weather = None
        self.weather.apply(weather)
        self.vehicle.light_lamps(weather.lamps)
        shine(self._beams, weather.lamps)
        self.place.light_windows(weather.lamps)
        self._weather = weather
