"""Where cameras that look at vehicles usually are, to begin with."""

from __future__ import annotations

import math
from dataclasses import dataclass

import bpy

from ..operator import RaucaOperator


@dataclass(frozen=True)
class Rings:
    """Cameras around, on rings from a lowest to a highest, degrees, and from a nearest to a farthest, metres."""

    around: int
    heights: int
    lowest_deg: float
    highest_deg: float
    distances: int
    nearest_m: float
    farthest_m: float
    fov_deg: float = 60.0


RINGS = {
    "STANDARD": Rings(8, 2, 10, 25, 2, 6, 10),
    "FEW": Rings(4, 1, 10, 25, 1, 6, 10),
    "STREET": Rings(12, 2, 3, 10, 3, 5, 20),
    "MAST": Rings(8, 2, 20, 40, 2, 12, 25, 40.0),
    "DRONE": Rings(8, 3, 45, 80, 2, 15, 40),
}


class RAUCA_OT_camera_preset(RaucaOperator, bpy.types.Operator):
    """Set the rings as cameras usually stand; jitter stays as it is"""

    bl_label = "Preset"
    preset: bpy.props.EnumProperty(
        name="Preset",
        items=[
            ("STANDARD", "Standard", "32 views from the height of a person to that of a truck"),
            ("FEW", "Few", "4 views, to try things"),
            ("STREET", "Dashboard Cameras", "72 views from cars in the street, near and far"),
            ("MAST", "Traffic Cameras", "32 views from masts and bridges, with a longer lens"),
            ("DRONE", "Drones", "48 views from above"),
        ],
    )

    def work(self, context: bpy.types.Context) -> None:
        settings, rings = context.scene.rauca.cameras, RINGS[self.preset]
        settings.azimuths, settings.elevations, settings.distances = rings.around, rings.heights, rings.distances
        settings.elevation_low = math.radians(rings.lowest_deg)
        settings.elevation_high = math.radians(rings.highest_deg)
        settings.distance_near, settings.distance_far = rings.nearest_m, rings.farthest_m
        settings.fov = math.radians(rings.fov_deg)
