"""Settings of the cameras step, kept in the scene, and what the cameras stand around."""

from __future__ import annotations

import math
from functools import partial

import bpy
import numpy as np

from ...core import contract, viewpoints
from ...scene.blocks import rendered
from ...scene.camera import look
from ...scene.vehicle_reading import NOWHERE, Anchor, find_anchor
from ..panel import angle

RING_SETTINGS = (
    *("azimuths", "elevation_low", "elevation_high", "elevations", "distance_near", "distance_far", "distances"),
    *("jitter_azimuth", "jitter_elevation", "jitter_distance", "jitter_aim", "jitter_roll", "fov", "view", "overlay"),
)
_known: dict[str, tuple[tuple[object, ...], Anchor]] = {}


def anchor(context: bpy.types.Context) -> Anchor:
    """The chosen vehicle's anchor; the world's origin when it is not in this scene. Quick enough for every redraw."""
    vehicle = context.scene.rauca.vehicle
    objects = rendered(vehicle.objects(context))
    if not objects:
        return NOWHERE
    request = vehicle.request()
    key = (request, *(_looks(thing) for thing in objects))
    scene = context.scene.name_full
    if scene not in _known or _known[scene][0] != key:
        _known[scene] = key, find_anchor(objects, request)
    return _known[scene][1]


def _looks(thing: bpy.types.Object) -> tuple[object, ...]:
    """What tells that an object was moved or reshaped; its box stands for its vertices."""
    corners = tuple(value for corner in thing.bound_box for value in corner)
    matrix = tuple(value for row in thing.matrix_world for value in row)
    return thing.name_full, thing.mode, len(thing.modifiers), corners, matrix


def _changed(self: RaucaCameras, context: bpy.types.Context) -> None:
    """The ring was changed: it is shown unless that was ever decided by hand, and the looked through view follows."""
    if not self.is_property_set("overlay"):
        self.overlay = True
    self.follow(context)


_angle = partial(angle, update=_changed)


def _metres(name: str, tip: str, default: float, low: float, high: float) -> bpy.props._PropertyDeferred:
    return bpy.props.FloatProperty(
        name=name, description=tip, subtype="DISTANCE", default=default, min=low, max=high, step=10, update=_changed
    )


def _count(name: str, tip: str, default: int, high: int) -> bpy.props._PropertyDeferred:
    return bpy.props.IntProperty(name=name, description=tip, default=default, min=1, max=high, update=_changed)


class RaucaCameras(bpy.types.PropertyGroup):
    """The rings of cameras, and the view that is looked through."""

    azimuths: _count("Around", "Cameras on each ring around the vehicle", 8, 360)
    elevation_low: _angle("Lowest", "The lowest ring, seen from the vehicle's middle", 10, -10, 89)
    elevation_high: _angle("Highest", "The highest ring, seen from the vehicle's middle", 25, -10, 89)
    elevations: _count("Heights", "Rings one above the other, from the lowest to the highest", 2, 32)
    distance_near: _metres("Nearest", "The nearest ring, from the vehicle's middle", 6, 0.5, 500)
    distance_far: _metres("Farthest", "The farthest ring, from the vehicle's middle", 10, 0.5, 500)
    distances: _count("Distances", "Rings one behind the other, from the nearest to the farthest", 2, 32)
    jitter_azimuth: _angle("Sideways", "Each camera strays so far to either side at random", 0, 0, 180)
    jitter_elevation: _angle("Up and Down", "Each camera strays so far up or down at random", 0, 0, 90)
    jitter_distance: bpy.props.FloatProperty(
        name="Distance", subtype="PERCENTAGE", min=0.0, max=90.0, precision=0, update=_changed,
        description="Each camera strays so far nearer or farther at random, in percent of its distance",
    )  # fmt: skip
    jitter_aim: _metres("Aim", "The point that each camera looks at strays so far at random", 0, 0, 100)
    jitter_roll: _angle("Tilt", "Each camera tilts so far to either side at random", 0, 0, 180)
    fov: _angle("Field of View", "How wide the cameras see", 60, 1, 170)
    overlay: bpy.props.BoolProperty(
        name="Show in Viewport",
        default=False,
        description="Draw the rings and cameras around the vehicle; comes on with the first change of a setting",
    )
    view: bpy.props.IntProperty(
        name="View", default=1, min=1, update=_changed, description="The view that is drawn large and looked through"
    )
    camera: bpy.props.PointerProperty(type=bpy.types.Object)
    camera_before: bpy.props.PointerProperty(type=bpy.types.Object)
    overrides: bpy.props.StringProperty(options={"HIDDEN"})

    def ring(self) -> contract.Ring:
        """The ring as the job renders it."""
        count = self.azimuths
        return contract.Ring(
            azimuths_deg=tuple(i * 360.0 / count for i in range(count)),
            elevations_deg=_spread(_degrees(self.elevation_low), _degrees(self.elevation_high), self.elevations),
            distances_m=_spread(round(self.distance_near, 4), round(self.distance_far, 4), self.distances),
            jitter_azimuth_deg=_degrees(self.jitter_azimuth),
            jitter_elevation_deg=_degrees(self.jitter_elevation),
            jitter_distance=round(self.jitter_distance / 100.0, 6),
            jitter_aim_m=round(self.jitter_aim, 4),
            jitter_roll_deg=_degrees(self.jitter_roll),
            fov_deg=_degrees(self.fov),
        )

    def shots(self) -> viewpoints.Shots:
        """Ring, picture size and seed, as the job gets them."""
        dataset = self.id_data.rauca.dataset
        return viewpoints.Shots(self.ring(), dataset.size, dataset.seed)

    @property
    def used(self) -> bool:
        """Whether anything of this step was set by hand in this file."""
        return any(self.is_property_set(name) for name in RING_SETTINGS)

    def chosen(self) -> int:
        """Index of the chosen view."""
        return min(int(self.view), len(self.ring())) - 1

    def viewpoint(self, context: bpy.types.Context) -> viewpoints.Viewpoint:
        """The chosen view's camera at the street of step 2, jitter included: what the job renders."""
        around = anchor(context)
        place = context.scene.rauca.weather.place - 1
        return viewpoints.viewpoint(self.shots(), place, self.chosen(), around.vehicle_to_world, around.center)

    @property
    def looking(self) -> bool:
        """True while the scene's camera is a view's."""
        return self.camera is not None and self.id_data.camera == self.camera

    def follow(self, context: bpy.types.Context) -> None:
        """Bring the camera that is looked through up to date; nothing is added to a scene without one."""
        if self.looking:
            look(self.id_data, self, self.viewpoint(context).camera)


def _spread(low: float, high: float, count: int) -> tuple[float, ...]:
    """``count`` values from low to high; their middle for one."""
    if count == 1:
        return (round((low + high) / 2, 4),)
    return tuple(round(float(value), 4) for value in np.linspace(low, high, count))


def _degrees(radians: float) -> float:
    # Single precision and radians: four decimals are what the user sees and means.
    return round(math.degrees(radians), 4)
