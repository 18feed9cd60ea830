"""Step 6: put a camouflage on the vehicle, and see what detectors found."""

from __future__ import annotations

from . import operators
from .detection_overlay import register, unregister
from .panel import RAUCA_PT_camouflage, RAUCA_PT_detections, RaucaCamouflage, state

CLASSES = (RaucaCamouflage, *operators.CLASSES, RAUCA_PT_camouflage, RAUCA_PT_detections)

__all__ = ["CLASSES", "RaucaCamouflage", "register", "state", "unregister"]
