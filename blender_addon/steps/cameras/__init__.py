"""Step 3: the cameras around the vehicle, drawn in the viewport."""

from __future__ import annotations

from . import operators
from .overlay import register, unregister
from .panel import RAUCA_PT_cameras, RAUCA_PT_cameras_jitter, state
from .properties import RaucaCameras

CLASSES = (RaucaCameras, *operators.CLASSES, RAUCA_PT_cameras, RAUCA_PT_cameras_jitter)

__all__ = ["CLASSES", "RaucaCameras", "register", "state", "unregister"]
