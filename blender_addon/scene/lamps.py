"""Lamps: those of the street, and the beams of the vehicle's headlamps."""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from ..core import contract

# A low beam: three times a street lamp's intensity, aimed at the road some fifteen metres ahead.
BEAM_ENERGY_W = 800.0
BEAM_COLOR = (1.0, 0.93, 0.82)
BEAM_ANGLE_DEG, BEAM_BLEND, BEAM_DIP_DEG = 50.0, 0.9, 2.5
BEAM_SOURCE_RADIUS_M = 0.06
FULL_ENERGY = "rauca_full_energy"
BEAM_OFFSET_M = 0.08  # before the lens, so that the lamp's own housing does not swallow the light


class StreetLamps:
    """A place's light objects, dimmed together; the energy they come with is full brightness.

    The list stays the place's own, which may fill it anew at each location.
    """

    def __init__(self, lamps: list[bpy.types.Object]) -> None:
        self._lamps = lamps

    def shine(self, level: float) -> None:
        """Turn all to ``level``, 0 (off) to 1."""
        for lamp in self._lamps:
            lamp.hide_render = level == 0.0
            if FULL_ENERGY not in lamp.data:  # kept on the light itself, which lamps may share
                lamp.data[FULL_ENERGY] = lamp.data.energy
            lamp.data.energy = lamp.data[FULL_ENERGY] * level


class VehicleLamps:
    """Beams of the headlamps, parented to the vehicle; the glow of the lenses is the vehicle's own.

    A vehicle without a material of kind ``headlamp`` has none.
    """

    def __init__(self, scene: bpy.types.Scene, vehicle_object: bpy.types.Object, vehicle: contract.Vehicle) -> None:
        self._beams: list[bpy.types.Object] = []
        for position in headlamp_positions(vehicle):
            light = bpy.data.lights.new("rauca headlamp", "SPOT")
            light.color, light.shadow_soft_size = BEAM_COLOR, BEAM_SOURCE_RADIUS_M
            light.spot_size, light.spot_blend = math.radians(BEAM_ANGLE_DEG), BEAM_BLEND
            beam = bpy.data.objects.new("rauca headlamp", light)
            beam.parent = vehicle_object
            beam.location = position
            dip = math.radians(BEAM_DIP_DEG)
            ahead = Vector((math.cos(dip), 0.0, -math.sin(dip)))
            beam.rotation_euler = ahead.to_track_quat("-Z", "Y").to_euler()
            beam.hide_render = True
            scene.collection.objects.link(beam)
            self._beams.append(beam)

    def shine(self, level: float) -> None:
        """Turn the beams to ``level``, 0 (off) to 1."""
        for beam in self._beams:
            beam.hide_render = level == 0.0
            beam.data.energy = BEAM_ENERGY_W * level


def headlamp_positions(vehicle: contract.Vehicle) -> NDArray[np.float64]:
    """Where beams start, (N, 3) metres in the vehicle's frame: before each side's headlamp glass; N is 0 to 2."""
    lenses = [i for i, material in enumerate(vehicle.materials) if material.kind == "headlamp"]
    faces = np.isin(vehicle.material, lenses)
    centers = vehicle.positions[vehicle.triangles[faces]].mean(axis=1).astype(np.float64)
    starts = []
    for side in (centers[:, 1] > 0, centers[:, 1] <= 0):
        if side.any():
            lens = centers[side]
            starts.append((lens[:, 0].max() + BEAM_OFFSET_M, lens[:, 1].mean(), lens[:, 2].mean()))
    return np.array(starts, np.float64).reshape(-1, 3)
