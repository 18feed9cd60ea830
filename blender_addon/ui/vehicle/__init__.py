"""Step 1: which vehicle, and what of it is paint."""

from .panel import RAUCA_PT_vehicle, RAUCA_PT_vehicle_paint, RAUCA_PT_vehicle_uvs
from .properties import RaucaVehicle
from .state import state

CLASSES = (RaucaVehicle, RAUCA_PT_vehicle, RAUCA_PT_vehicle_paint, RAUCA_PT_vehicle_uvs)

__all__ = ["CLASSES", "RaucaVehicle", "state"]
