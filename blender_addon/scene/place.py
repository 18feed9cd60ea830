"""What a place gives the vehicle: somewhere to stand, and lamps for the night."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core import contract


class Place(Protocol):
    """The surroundings of a data set, inside a scene.

    Attributes:
        lamps: light objects that the weather switches on at night.
        notes: what was left out or assumed, for people.
    """

    lamps: list[bpy.types.Object]
    notes: list[str]

    def pose(self, location: int) -> NDArray[np.float64]:
        """(4, 4) rigid vehicle-to-world transform of a location; wheels on the ground, front along its +x."""

    def enter(self, location: int) -> None:
        """Show what surrounds a location; called before anything there is rendered."""

    def light_windows(self, level: float) -> None:
        """Turn up what shines after dark without being a lamp, 0 (by day) to 1."""


def build_place(scene: bpy.types.Scene, plan: contract.Plan, blend: Path | None, own: str = "car") -> Place:
    """Add the plan's surroundings to the scene.

    Args:
        blend: the user's file when the plan was made with one.
        own: class of the data set's vehicle, of which nothing else may be.

    Raises:
        RaucaError: the file is missing, is not the one the plan was made with, or marks no location.
    """
    if plan.scenery.kind == "town":
        from .town import Town

        return Town(scene, plan.seed, own)
    if blend is None:
        raise contract.RaucaError(f"this data set was made in {plan.scenery.name}; give that file as --scene")
    if contract.Scenery.of_file(blend) != plan.scenery:
        raise contract.RaucaError(f"{blend}: not the scene this data set was made in ({plan.scenery.name})")
    from .user_scene import UserScene

    return UserScene(scene, blend, plan.locations, own)
