"""Step 6: put a camouflage on the vehicle, and see what detectors found."""

from . import boxes
from .panel import RAUCA_PT_camouflage, RAUCA_PT_detections
from .properties import RaucaCamouflage
from .state import state

CLASSES = (RaucaCamouflage, RAUCA_PT_camouflage, RAUCA_PT_detections)
register, unregister = boxes.register, boxes.unregister

__all__ = ["CLASSES", "RaucaCamouflage", "register", "state", "unregister"]
