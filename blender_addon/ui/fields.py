"""Kinds of settings that several steps have."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import bpy

from ..translations import OWN_SENSE


def angle(
    name: str, tip: str, default_deg: float, low_deg: float, high_deg: float, *, update: Callable[..., Any]
) -> bpy.props._PropertyDeferred:
    """An angle, given in degrees; Blender keeps it in radians."""
    low, high, default = (math.radians(x) for x in (low_deg, high_deg, default_deg))
    return bpy.props.FloatProperty(
        name=name,
        translation_context=OWN_SENSE,
        description=tip,
        subtype="ANGLE",
        default=default,
        min=low,
        max=high,
        step=100,
        update=update,
    )
