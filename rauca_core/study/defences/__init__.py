"""Image pre-processing in front of a detector: what a defender might do to a camouflaged picture."""

from .interface import NO_DEFENCE, Defence
from .registry import defence_names, make_defence, ready_defences

__all__ = ["NO_DEFENCE", "Defence", "defence_names", "make_defence", "ready_defences"]
